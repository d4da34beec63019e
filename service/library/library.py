"""Everything that the service keeps: one folder, one process at a time."""

from __future__ import annotations

import fcntl
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from service.library.captures import CaptureStore
from service.library.disk import Space, sweep
from service.library.errors import BusyError, DiskFullError, LibraryError
from service.library.idempotency import IdempotencyStore
from service.library.ids import IdSource
from service.library.reconstructions import ReconstructionStore

_LOCK_NAME, _WORK_NAME = ".lock", ".work"


@dataclass(frozen=True)
class LibraryLimits:
    """minimum_free_bytes: of the disk, below which nothing more is written. idempotency_entries: answers kept."""

    minimum_free_bytes: int = 512 * 2**20
    idempotency_entries: int = 10_000


class Library:
    """Captures, reconstructions and remembered answers below one folder; may be used by many threads.

    Use ``Library.open``, and ``close`` or a with statement.
    """

    def __init__(self, root: Path, lock: int, limits: LibraryLimits) -> None:
        self.root = root
        self._lock: int | None = lock
        self._ids = IdSource()
        work = root / _WORK_NAME
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(exist_ok=True)
        sweep(root)
        self._space = space = Space(root, limits.minimum_free_bytes)
        self.captures = CaptureStore(root / "captures", self._ids, space)
        self.reconstructions = ReconstructionStore(root / "reconstructions", work, self._ids, space)
        self.idempotency = IdempotencyStore(root / "idempotency", limits.idempotency_entries)

    @classmethod
    def open(cls, root: Path, limits: LibraryLimits = LibraryLimits()) -> Library:
        """Open a library, which is made where it does not exist, and sweep what a killed process left unfinished.

        Raises BusyError while another process (or another Library of this one) has it open; the system frees that lock
        however a process ends. Raises LibraryError when the folder cannot be used.
        """
        try:
            root.mkdir(parents=True, exist_ok=True)
            lock = os.open(root / _LOCK_NAME, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise LibraryError(f"library '{root}' cannot be opened: {error.strerror or error}") from error
        try:
            _take(lock, root)
            return cls(root, lock, limits)
        except OSError as error:
            os.close(lock)
            raise LibraryError(f"library '{root}' cannot be opened: {error.strerror or error}") from error
        except LibraryError:
            os.close(lock)
            raise

    def new_id(self) -> str:
        """A new id for a capture or reconstruction, greater than all that this process made before."""
        return self._ids.new_id()

    @property
    def work(self) -> Path:
        """Folder for what is not finished; emptied when the library is opened."""
        return self.root / _WORK_NAME

    @property
    def free_bytes(self) -> int:
        """Free space of the library's disk."""
        return shutil.disk_usage(self.root).free

    def require_space(self, needed_bytes: int = 0) -> None:
        """Raise DiskFullError unless so many bytes can be written; for use before work that nobody could store."""
        self._space.require(needed_bytes)

    def fault(self) -> str | None:
        """Why nothing can be stored at this moment, or None."""
        if not os.access(self.root, os.W_OK | os.X_OK):
            return f"library '{self.root}' is not there or may not be written to"
        try:
            self.require_space()
        except DiskFullError as error:
            return str(error)
        return None

    def close(self) -> None:
        """Let another process open the library; nothing of it may be used after."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> Library:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _take(lock: int, root: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.pread(lock, 20, 0).decode("ascii", "replace").strip()
        raise LibraryBusyError(root, holder if holder.isdigit() else "unknown") from error
    os.ftruncate(lock, 0)
    os.pwrite(lock, f"{os.getpid()}\n".encode("ascii"), 0)


class LibraryBusyError(BusyError):
    """Another process has the library open."""

    def __init__(self, root: Path, holder: str) -> None:
        super().__init__(
            f"library '{root}' is open in another service (process {holder}); stop that one or use another folder"
        )
