"""The library on disk: captures, reconstructions, and answers that are remembered."""

from service.library.archive import ArchiveStream
from service.library.archive_import import ArchiveLimits
from service.library.captures import CaptureStore, StoredCapture
from service.library.errors import (
    ArchiveError,
    BusyError,
    CursorError,
    DamagedError,
    DiskFullError,
    InvalidIdError,
    LibraryError,
    LimitError,
    NotFoundError,
)
from service.library.idempotency import Fresh, IdempotencyStore, InProgress, Mismatch, Replay
from service.library.library import Library, LibraryBusyError, LibraryLimits
from service.library.paging import Page
from service.library.reconstructions import ReconstructionStore, StoredReconstruction

__all__ = [
    "ArchiveError",
    "ArchiveLimits",
    "ArchiveStream",
    "BusyError",
    "CaptureStore",
    "CursorError",
    "DamagedError",
    "DiskFullError",
    "Fresh",
    "IdempotencyStore",
    "InProgress",
    "InvalidIdError",
    "Library",
    "LibraryBusyError",
    "LibraryError",
    "LibraryLimits",
    "LimitError",
    "Mismatch",
    "NotFoundError",
    "Page",
    "ReconstructionStore",
    "Replay",
    "StoredCapture",
    "StoredReconstruction",
]
