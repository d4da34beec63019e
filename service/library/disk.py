"""Writing where space may end, and removing so that nobody sees a half."""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from models.atomic import sync
from models.errors import DuofringeError
from service.library.errors import DiskFullError, LibraryError

DELETED_PREFIX = ".deleted-"
_PARTIAL_MARK = ".partial-"
_MIB = 2**20


class Space:
    """The disk under a library. minimum_free_bytes: what must stay free for the rest of the machine."""

    def __init__(self, folder: Path, minimum_free_bytes: int) -> None:
        self._folder = folder
        self._minimum = minimum_free_bytes

    def require(self, needed_bytes: int) -> None:
        """Raise DiskFullError unless so many bytes fit."""
        free = shutil.disk_usage(self._folder).free
        if free - needed_bytes < self._minimum:
            raise DiskFullError(
                f"the library's disk has {free // _MIB} MiB free, {self._minimum // _MIB} MiB must stay free and "
                f"{max(1, needed_bytes // _MIB)} MiB are needed; delete captures or reconstructions"
            )

    @contextmanager
    def writing(self, what: str, needed_bytes: int) -> Iterator[None]:
        """Turn what the disk refuses while ``what`` is written into one line; LibraryError or DiskFullError."""
        self.require(needed_bytes)
        try:
            yield
        except (OSError, DuofringeError) as error:
            if _is_full(error):
                raise DiskFullError(
                    f"{what} was not kept: the library's disk is full; delete captures or reconstructions"
                ) from error
            if isinstance(error, OSError):
                raise LibraryError(f"{what} was not kept: {error.strerror or error}") from error
            raise


def _is_full(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return True
        error = error.__cause__
    return False


def remove_folder(folder: Path) -> None:
    """Remove a folder that vanishes at once from its name; raises FileNotFoundError when it is absent."""
    doomed = folder.with_name(f"{DELETED_PREFIX}{folder.name}-{uuid.uuid4().hex[:8]}")
    folder.rename(doomed)
    sync(folder.parent)
    shutil.rmtree(doomed, ignore_errors=True)  # what resists is swept when the library is opened again


def sweep(folder: Path) -> int:
    """Remove what a killed process left unfinished in a folder; returns how many entries."""
    count = 0
    with os.scandir(folder) as entries:
        for entry in entries:
            if not entry.name.startswith(".") or not (
                entry.name.startswith(DELETED_PREFIX) or _PARTIAL_MARK in entry.name
            ):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                Path(entry.path).unlink(missing_ok=True)
            count += 1
    return count


def size_of(folder: Path) -> int:
    """Bytes of all files under a folder; files that vanish meanwhile count nothing."""
    total = 0
    for path, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.stat(os.path.join(path, name), follow_symlinks=False).st_size  # noqa: PTH116, PTH118
            except FileNotFoundError:
                continue
    return total
