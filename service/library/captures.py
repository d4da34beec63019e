"""Captures on disk, one folder each, exactly as docs/formats.md tells."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from pydantic import BaseModel, ConfigDict

from models.capture import Capture, CaptureRecord, DeviceRecord, read_capture, read_outline, write_capture
from models.errors import CaptureError
from models.geometry.rig import Side
from models.patterns import PatternKind
from service.library.archive import ArchiveStream, stream_archive
from service.library.archive_import import ArchiveLimits, extract_capture
from service.library.disk import Space, size_of
from service.library.errors import DamagedError, NotFoundError
from service.library.folder_index import Facts, FolderIndex
from service.library.ids import IdSource, time_of
from service.library.paging import Page

KIND = "capture"


class StoredCapture(BaseModel):
    """A capture without its pixels. damaged: why it cannot be read, else None; what is unknown then is empty.

    size: (width, height) of the left images, px. bytes_on_disk: of all its files. extra: what else its record holds.
    """

    model_config = ConfigDict(frozen=True)

    id: str
    created: datetime
    plan: str = ""
    patterns: tuple[str, ...] = ()
    sides: tuple[Side, ...] = ()
    size: tuple[int, int] | None = None
    bit_depth: int | None = None
    devices: tuple[DeviceRecord, ...] = ()
    settings: dict[str, Any] = {}
    warnings: tuple[str, ...] = ()
    object_id: str | None = None
    has_truth: bool = False
    has_calibration: bool = False
    bytes_on_disk: int = 0
    extra: dict[str, Any] = {}
    damaged: str | None = None


class CaptureStore:
    """The captures of a library; may be used by many threads."""

    def __init__(self, folder: Path, ids: IdSource, space: Space) -> None:
        self._ids, self._space = ids, space
        self._index = FolderIndex[StoredCapture](folder, KIND, _describe, _facts)

    def __len__(self) -> int:
        return len(self._index)

    def __contains__(self, id: str) -> bool:
        return id in self._index

    def add(self, capture: Capture, id: str) -> StoredCapture:
        """Keep a capture under a new id, which its record takes; when this returns it would survive a power failure.

        Raises InvalidIdError, LibraryError when the id exists, DiskFullError; then nothing is left of it.
        """
        path = self._index.new_path(id)
        kept = replace(capture, record=capture.record.model_copy(update={"id": id}))
        needed = sum(image.nbytes for images in capture.images.values() for image in images.values())
        with self._space.writing(f"{KIND} '{id}'", needed):
            write_capture(kept, path)
        return self._index.insert(id)

    def import_archive(
        self,
        source: Path | BinaryIO,
        limits: ArchiveLimits = ArchiveLimits(),  # noqa: B008
        *,
        id: str | None = None,
    ) -> StoredCapture:
        """Keep the capture of a zip under a new id; the id that it had stays in its record as ``imported_id``.

        Raises ArchiveError for everything that is wrong with the zip, and DiskFullError; then nothing is left of it.
        """
        new = id or self._ids.new_id()
        path = self._index.new_path(new)
        with self._space.writing(f"{KIND} '{new}'", 0):
            extract_capture(source, path, limits, self._space)
        return self._index.insert(new)

    def get(self, id: str) -> StoredCapture:
        """Describe a capture, a damaged one too; raises InvalidIdError and NotFoundError."""
        return self._index.get(id)

    def read(
        self,
        id: str,
        kinds: Collection[PatternKind] | None = None,
        *,
        with_truth: bool = True,
    ) -> Capture:
        """Read a capture, or only the groups ``kinds`` of it, as ``read_capture`` does.

        Raises InvalidIdError, NotFoundError (also when it is deleted meanwhile) and DamagedError.
        """
        path = self._index.path(id)
        try:
            capture = read_capture(path, kinds=kinds, with_truth=with_truth)
        except (CaptureError, OSError) as error:
            raise _fault(id, path, error) from error
        return replace(capture, source=f"{KIND} {id}")

    def image_path(self, id: str, side: str, pattern: str) -> Path:
        """PNG of one view under one pattern; both must stand in the record.

        Raises InvalidIdError, NotFoundError and DamagedError.
        """
        path, stored = self._index.path(id), self._index.get(id)
        if stored.damaged is not None:
            raise DamagedError(KIND, id, stored.damaged)
        if side not in stored.sides or pattern not in stored.patterns:
            raise NotFoundError(KIND, id, "has no such image; its record names its sides and patterns")
        return path / side / f"{pattern}.png"

    def archive(self, id: str) -> ArchiveStream:
        """The whole capture as a zip, made while it is sent; raises InvalidIdError and NotFoundError."""
        path = self._index.path(id)
        try:
            return stream_archive(path)
        except FileNotFoundError as error:
            raise NotFoundError(KIND, id) from error

    def page(
        self,
        limit: int,
        cursor: str | None = None,
        newest_first: bool = True,
        plan: str | None = None,
        object_id: str | None = None,
    ) -> Page[StoredCapture]:
        """Captures in the order of their making, of one plan or object where these are given; raises CursorError."""

        def keep(facts: Facts) -> bool:
            return (plan is None or facts[0] == plan) and (object_id is None or facts[1] == object_id)

        filtered = plan is not None or object_id is not None
        return self._index.page(limit, cursor, newest_first=newest_first, keep=keep if filtered else None)

    def delete(self, id: str) -> None:
        """Delete a capture; its reconstructions stay, for they are results. Raises InvalidIdError and NotFoundError."""
        self._index.delete(id)


def _facts(stored: StoredCapture) -> Facts | None:
    return None if stored.damaged is not None else (stored.plan, stored.object_id)


def _describe(id: str, path: Path) -> StoredCapture:
    try:
        outline = read_outline(path)
        size = size_of(path)
    except (CaptureError, OSError) as error:
        fault = _fault(id, path, error)
        if isinstance(fault, NotFoundError):
            raise fault from error
        return StoredCapture(id=id, created=time_of(id), bytes_on_disk=size_of(path), damaged=fault.reason)
    record = outline.record or CaptureRecord(created=time_of(id))
    return StoredCapture(
        id=id,
        created=record.created if record.created.tzinfo else record.created.replace(tzinfo=UTC),
        plan=outline.plan.name,
        patterns=outline.plan.names,
        sides=outline.sides,
        size=outline.size,
        bit_depth=record.bit_depth,
        devices=record.devices,
        settings=record.settings,
        warnings=record.warnings,
        object_id=record.object_id,
        has_truth=(path / "truth").is_dir(),
        has_calibration=record.calibration is not None,
        bytes_on_disk=size,
        extra=record.model_extra or {},
    )


def _fault(id: str, path: Path, error: Exception) -> NotFoundError | DamagedError:
    """What a failure to read amounts to: the folder is gone, or it is damaged."""
    if not path.is_dir():
        return NotFoundError(KIND, id)
    text = str(error).removeprefix(f"{path}: ").replace(f"{path}/", "").replace(str(path), f"{KIND} {id}")
    return DamagedError(KIND, id, text)
