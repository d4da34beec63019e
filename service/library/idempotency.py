"""Answers remembered by the key of their request, so that a repeated request moves the hardware once."""

from __future__ import annotations

import hashlib
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from models.atomic import write_text_atomically
from service.library.disk import sweep
from service.library.errors import LibraryError, LimitError
from service.library.ids import check_id

LONGEST_KEY = 200
KEPT_S = 24 * 3600.0


@dataclass(frozen=True)
class Fresh:
    """The request is the caller's to answer, with ``finish`` or ``abandon``.

    planned_id: of what it is to make. resumed: a process that was killed had begun it, under this id; whether the thing
    exists already is for the caller to look.
    """

    planned_id: str
    resumed: bool = False


@dataclass(frozen=True)
class InProgress:
    """Another thread of this process is answering this very request."""

    planned_id: str


@dataclass(frozen=True)
class Replay:
    """The request was answered before, with this HTTP status and JSON body."""

    status: int
    body: Any


@dataclass(frozen=True)
class Mismatch:
    """The key belongs to another request."""


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True)

    request: str
    planned_id: str
    status: int | None = None
    body: Any = None


class IdempotencyStore:
    """Remembered requests, one small file each, for a day; may be used by many threads.

    Only the hash of a key is kept. limit: on the number of entries; the oldest answers give way to new requests.
    """

    def __init__(self, folder: Path, limit: int = 10_000) -> None:
        folder.mkdir(exist_ok=True)
        sweep(folder)
        self._folder, self._limit = folder, limit
        self._lock = threading.Lock()
        self._running: set[str] = set()
        with os.scandir(folder) as entries:
            ages = {
                e.name: e.stat().st_mtime for e in entries if e.name.endswith(".json") and not e.name.startswith(".")
            }
        self._times = dict(sorted(ages.items(), key=lambda item: item[1]))
        self._drop_old()

    def __len__(self) -> int:
        with self._lock:
            return len(self._times)

    def begin(self, key: str, request_hash: str, planned_id: str) -> Fresh | InProgress | Replay | Mismatch:
        """What to do about a request; Fresh is on disk before it is returned.

        key: any text of 1 to 200 characters. Raises LibraryError for another key and LimitError when the store is full
        of requests under way.
        """
        name = _file_name(key)
        check_id(planned_id)
        with self._lock:
            self._drop_old()
            entry = self._read(name)
            if entry is None:
                self._make_room()
                self._write(name, _Entry(request=request_hash, planned_id=planned_id))
                self._running.add(name)
                return Fresh(planned_id)
            if entry.request != request_hash:
                return Mismatch()
            if entry.status is not None:
                return Replay(entry.status, entry.body)
            if name in self._running:
                return InProgress(entry.planned_id)
            self._running.add(name)
            return Fresh(entry.planned_id, resumed=True)

    def finish(self, key: str, status: int, body: Any) -> None:
        """Remember the answer to a request that ``begin`` called fresh; body: what JSON holds."""
        name = _file_name(key)
        with self._lock:
            entry = self._read(name)
            if entry is None or name not in self._running:
                raise LibraryError("this key was not begun, or was answered already")
            self._write(name, entry.model_copy(update={"status": status, "body": body}))
            self._running.discard(name)

    def abandon(self, key: str) -> None:
        """Forget a request that ``begin`` called fresh and that failed: a repeated one starts anew."""
        name = _file_name(key)
        with self._lock:
            if name not in self._running:
                raise LibraryError("this key was not begun, or was answered already")
            self._drop(name)

    def _read(self, name: str) -> _Entry | None:
        if name not in self._times:
            return None
        try:
            return _Entry.model_validate_json((self._folder / name).read_bytes())
        except (FileNotFoundError, ValidationError):
            self._drop(name)
            return None

    def _write(self, name: str, entry: _Entry) -> None:
        try:
            write_text_atomically(self._folder / name, entry.model_dump_json() + "\n")
        except OSError as error:
            raise LibraryError(f"the request could not be remembered: {error.strerror or error}") from error
        self._times.pop(name, None)
        self._times[name] = time.time()  # the end of the dict is the youngest

    def _drop(self, name: str) -> None:
        (self._folder / name).unlink(missing_ok=True)
        self._times.pop(name, None)
        self._running.discard(name)

    def _drop_old(self) -> None:
        horizon = time.time() - KEPT_S
        for name, written in list(self._times.items()):
            if written > horizon:
                break
            if name not in self._running:
                self._drop(name)

    def _make_room(self) -> None:
        if len(self._times) < self._limit:
            return
        name = next((name for name in self._times if name not in self._running), None)
        if name is None:
            raise LimitError(f"{self._limit} requests with keys are under way; wait until some are answered")
        self._drop(name)


def _file_name(key: str) -> str:
    if not 1 <= len(key) <= LONGEST_KEY:
        raise LibraryError(f"an idempotency key has 1 to {LONGEST_KEY} characters; this one has {len(key)}")
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest() + ".json"
