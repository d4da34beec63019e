"""Which folders of a store exist, and short descriptions of them, so that lists need not read the disk again."""

# ruff: noqa: A001, A002  (an id is called id)

from __future__ import annotations

import bisect
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from service.library.disk import remove_folder, sweep
from service.library.errors import LibraryError, NotFoundError
from service.library.ids import check_id, is_id
from service.library.paging import Page, check_limit, decode_cursor, encode_cursor

Item = TypeVar("Item")
Facts = tuple[str | None, ...]
_KEPT = 2048
_CHUNK = 64


class FolderIndex(Generic[Item]):
    """Folders named by ids, in the order of their ids; may be used by many threads.

    Opening lists the names only; a description is read when it is asked for, and the latest are kept. kind: what a
    folder holds, for errors. load: describes a folder; raises NotFoundError when it vanished. facts: what lists are
    filtered by, kept for every folder; None for a description that must be read anew each time, of a damaged folder.
    """

    def __init__(
        self, folder: Path, kind: str, load: Callable[[str, Path], Item], facts: Callable[[Item], Facts | None]
    ) -> None:
        folder.mkdir(exist_ok=True)
        sweep(folder)
        self._folder, self._kind, self._load, self._facts_of = folder, kind, load, facts
        self._lock = threading.Lock()
        self._ids = sorted(p.name for p in folder.iterdir() if is_id(p.name))
        self._items: OrderedDict[str, Item] = OrderedDict()
        self._facts: dict[str, Facts] = {}

    def __len__(self) -> int:
        with self._lock:
            return len(self._ids)

    def __contains__(self, id: str) -> bool:
        with self._lock:
            return self._holds(id)

    def path(self, id: str) -> Path:
        """Folder of an id; raises InvalidIdError, and NotFoundError when there is none."""
        check_id(id)
        folder = self._folder / id
        if id not in self or not folder.is_dir():
            raise NotFoundError(self._kind, id)
        return folder

    def new_path(self, id: str) -> Path:
        """Where the folder of a new id is to come; raises LibraryError when there is one already."""
        folder = self._folder / check_id(id)
        if folder.exists():
            raise LibraryError(f"{self._kind} '{id}' exists already")
        return folder

    def get(self, id: str) -> Item:
        """Description of a folder; raises InvalidIdError and NotFoundError."""
        folder = self.path(id)
        with self._lock:
            if id in self._items:
                self._items.move_to_end(id)
                return self._items[id]
        item = self._load(id, folder)
        self._keep(id, item)
        return item

    def insert(self, id: str) -> Item:
        """Take up a folder that has just been written, and describe it."""
        with self._lock:
            if not self._holds(id):
                bisect.insort(self._ids, id)
        return self.get(id)

    def delete(self, id: str) -> None:
        """Remove a folder; it vanishes at once and its files after. Raises InvalidIdError and NotFoundError."""
        folder = self.path(id)
        try:
            remove_folder(folder)
        except FileNotFoundError as error:
            raise NotFoundError(self._kind, id) from error
        except OSError as error:
            raise LibraryError(f"{self._kind} '{id}' could not be deleted: {error.strerror or error}") from error
        self._forget(id)

    def page(
        self,
        limit: int,
        cursor: str | None = None,
        *,
        newest_first: bool = True,
        keep: Callable[[Facts], bool] | None = None,
    ) -> Page[Item]:
        """Up to ``limit`` descriptions after ``cursor``; those that ``keep`` refuses by their facts are left out.

        Damaged folders have no facts: they stand in lists without a filter only. Raises CursorError.
        """
        check_limit(limit)
        last = None if cursor is None else decode_cursor(cursor, newest_first=newest_first)
        found: list[tuple[str, Item]] = []
        while len(found) <= limit and (chunk := self._after(last, newest_first)):
            for id in chunk:
                last = id
                if keep is not None and not self._passes(id, keep):
                    continue
                try:
                    found.append((id, self.get(id)))
                except NotFoundError:  # deleted meanwhile, or removed by hand
                    self._forget(id)
                if len(found) > limit:
                    break
        more = len(found) > limit
        shown = found[:limit]
        return Page(
            tuple(item for _, item in shown), encode_cursor(shown[-1][0], newest_first=newest_first) if more else None
        )

    def _passes(self, id: str, keep: Callable[[Facts], bool]) -> bool:
        facts = self._facts.get(id)
        if facts is None:
            try:
                facts = self._facts_of(self.get(id))
            except NotFoundError:
                return False
        return facts is not None and keep(facts)

    def _after(self, last: str | None, newest_first: bool) -> list[str]:
        with self._lock:
            if newest_first:
                end = len(self._ids) if last is None else bisect.bisect_left(self._ids, last)
                return self._ids[max(0, end - _CHUNK) : end][::-1]
            start = 0 if last is None else bisect.bisect_right(self._ids, last)
            return self._ids[start : start + _CHUNK]

    def _holds(self, id: str) -> bool:
        at = bisect.bisect_left(self._ids, id)
        return at < len(self._ids) and self._ids[at] == id

    def _keep(self, id: str, item: Item) -> None:
        facts = self._facts_of(item)
        with self._lock:
            if facts is None or not self._holds(id):  # not what a thread read just before it was deleted
                return
            self._facts[id] = facts
            self._items[id] = item
            self._items.move_to_end(id)
            while len(self._items) > _KEPT:
                self._items.popitem(last=False)

    def _forget(self, id: str) -> None:
        with self._lock:
            at = bisect.bisect_left(self._ids, id)
            if at < len(self._ids) and self._ids[at] == id:
                del self._ids[at]
            self._items.pop(id, None)
            self._facts.pop(id, None)
