"""Jobs on disk, one folder each."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from models.atomic import atomic_folder, write_text_atomically
from service.jobs.record import RECORD_NAME, JobRecord
from service.library.errors import LibraryError, NotFoundError
from service.library.folder_index import FolderIndex
from service.library.ids import time_of
from service.library.paging import MAXIMUM_LIMIT, Page

KIND = "job"


class JobStore:
    """The jobs of a library; may be used by many threads, of which one at a time changes a job."""

    def __init__(self, folder: Path) -> None:
        # Without facts a description is read anew each time: a job goes on while it is looked at.
        self._index = FolderIndex[JobRecord](folder, KIND, _read, lambda _: None)

    def __len__(self) -> int:
        return len(self._index)

    def __contains__(self, id: str) -> bool:
        return id in self._index

    def folder(self, id: str) -> Path:
        """Folder of a job; raises InvalidIdError and NotFoundError."""
        return self._index.path(id)

    def add(self, record: JobRecord) -> JobRecord:
        """Keep a new job, which from then on survives a power failure. Raises LibraryError."""
        path = self._index.new_path(record.id)
        try:
            with atomic_folder(path) as partial:
                (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")
        except OSError as error:
            raise LibraryError(f"{KIND} '{record.id}' was not kept: {error.strerror or error}") from error
        return self._index.insert(record.id)

    def get(self, id: str) -> JobRecord:
        """A job as its file tells it, a damaged one too; raises InvalidIdError and NotFoundError."""
        return self._index.get(id)

    def change(self, id: str, **changed: Any) -> JobRecord:
        """Write a job's record with other values of these fields; returns it. Raises LibraryError."""
        record = self.get(id).model_copy(update=changed)
        try:
            write_text_atomically(self.folder(id) / RECORD_NAME, record.to_json())
        except OSError as error:
            raise LibraryError(f"{KIND} '{id}' could not be written: {error.strerror or error}") from error
        return record

    def discard_output(self, id: str) -> None:
        """Remove all that a job has written, but its record."""
        for path in self.folder(id).iterdir():
            if path.name == RECORD_NAME:
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)

    def page(self, limit: int, cursor: str | None = None, newest_first: bool = True) -> Page[JobRecord]:
        """Jobs in the order of their making; raises CursorError."""
        return self._index.page(limit, cursor, newest_first=newest_first)

    def __iter__(self) -> Iterator[JobRecord]:
        """All jobs, the oldest first."""
        cursor: str | None = None
        while True:
            page = self.page(MAXIMUM_LIMIT, cursor, newest_first=False)
            yield from page.items
            cursor = page.next_cursor
            if cursor is None:
                return


def _read(id: str, path: Path) -> JobRecord:
    try:
        return JobRecord.model_validate_json((path / RECORD_NAME).read_bytes())
    except (OSError, ValidationError) as error:
        if not path.is_dir():
            raise NotFoundError(KIND, id) from error
        told = error.errors()[0]["msg"] if isinstance(error, ValidationError) else error.strerror
        return JobRecord(
            id=id, kind=None, state="failed", created=time_of(id), error=f"{RECORD_NAME} is damaged: {told}"
        )
