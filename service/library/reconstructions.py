"""Reconstructions on disk: record, points and phases at once; clouds for other programs and pictures when asked for."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from models.atomic import atomic_folder
from models.errors import DuofringeError, ReconstructionError
from models.export.npz import read_npz, write_npz
from models.points import PointMap
from models.reconstruct import Reconstruction
from service.library.artefacts import (
    ARTEFACTS,
    PHASE_ARTEFACTS,
    PHASES_FILE,
    POINTS_FILE,
    Artefact,
    file_name,
    make_artefact,
)
from service.library.disk import Space, size_of
from service.library.errors import DamagedError, DiskFullError, NotFoundError
from service.library.folder_index import Facts, FolderIndex
from service.library.ids import IdSource, check_id, time_of
from service.library.keyed_lock import KeyedLock
from service.library.paging import Page
from service.library.phases import write_phases
from service.library.reconstruction_record import RECORD_NAME, ReconstructionRecord, record_of
from service.library.report import CAPTIONS, embedded, report_page

KIND = "reconstruction"


class StoredReconstruction(BaseModel):
    """A reconstruction without its arrays. record: None where the folder is damaged, and damaged tells why.

    bytes_on_disk: of all files when it was first looked at; artefacts that were made since are not in it.
    """

    model_config = ConfigDict(frozen=True)

    id: str
    created: datetime
    record: ReconstructionRecord | None
    bytes_on_disk: int
    damaged: str | None = None

    @property
    def artefacts(self) -> tuple[Artefact, ...]:
        """Names that ``ReconstructionStore.artefact`` takes for this one."""
        return tuple(name for name in ARTEFACTS if self.record is not None and _has(self.record, name))


class ReconstructionStore:
    """The reconstructions of a library; may be used by many threads."""

    def __init__(self, folder: Path, work: Path, ids: IdSource, space: Space) -> None:
        self._work, self._ids, self._space = work, ids, space
        self._index = FolderIndex[StoredReconstruction](folder, KIND, _describe, _facts)
        self._making = KeyedLock()

    def __len__(self) -> int:
        return len(self._index)

    def __contains__(self, id: str) -> bool:
        return id in self._index

    def add(
        self,
        reconstruction: Reconstruction,
        capture_id: str,
        extra: dict[str, Any],
        *,
        id: str | None = None,
    ) -> StoredReconstruction:
        """Keep a reconstruction; from then on it survives the death of the process.

        A power failure in the next seconds may damage it, which is noticed: it can be made again from its capture, and
        waiting for the disk would hold up every answer.

        extra: what JSON holds; "warnings", a list of texts, is shown in the report. id: a new id; None makes one.
        Raises InvalidIdError, LibraryError when the id exists, DiskFullError; then nothing is left of it.
        """
        new = id or self._ids.new_id()
        path = self._index.new_path(new)
        check_id(capture_id)
        points, phases = reconstruction.points, reconstruction.phases
        if len(points) == 0:
            raise ReconstructionError(f"{KIND} '{new}' was not kept: no pixel has a point")
        with (
            self._space.writing(f"{KIND} '{new}'", 64 * points.mask.size),
            atomic_folder(path, durable=False) as partial,
            ThreadPoolExecutor(2) as pool,
        ):
            written = [
                pool.submit(write_npz, points, partial / POINTS_FILE, compressed=False),
                pool.submit(write_phases, phases, partial / PHASES_FILE),
            ]
            record = record_of(reconstruction, new, capture_id, extra)
            (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")
            for future in written:
                future.result()
        return self._index.insert(new)

    def get(self, id: str) -> StoredReconstruction:
        """Describe a reconstruction, a damaged one too; raises InvalidIdError and NotFoundError."""
        return self._index.get(id)

    def load_points(self, id: str) -> PointMap:
        """The point map; raises InvalidIdError, NotFoundError and DamagedError."""
        path = self._index.path(id)
        try:
            return read_npz(path / POINTS_FILE)
        except ReconstructionError as error:
            raise _fault(id, path, error) from error

    def artefact(self, id: str, name: str) -> Path:
        """File of a cloud or picture, made on first demand and once however many ask. name: one of ``ARTEFACTS``.

        Raises InvalidIdError; NotFoundError for an unknown name, a phase that the method does not make, or a
        reconstruction that is deleted meanwhile; DamagedError; DiskFullError.
        """
        record = self._record(id)
        artefact = next((known for known in ARTEFACTS if known == name), None)
        if artefact is None:
            raise NotFoundError(KIND, id, f"has no such file; ask for one of {', '.join(ARTEFACTS)}")
        if not _has(record, artefact):
            carrier, side = PHASE_ARTEFACTS[artefact]
            raise NotFoundError(KIND, id, f"has no phase of the {carrier} carrier in the {side} view")
        folder = self._index.path(id)
        path = folder / file_name(artefact)
        if not path.is_file():
            with self._making.hold((id, artefact)):
                if not path.is_file():
                    self._make(artefact, id, folder, path)
        return path

    def report(self, id: str, links: Mapping[str, str] | None = None) -> str:
        """A page of HTML that loads nothing from elsewhere; every text in it is escaped.

        links: URL of each picture by its name in ``ARTEFACTS``; pictures without one are left out. None embeds them
        all, for a page that stands alone. Raises as ``artefact`` does.
        """
        record = self._record(id)
        if links is None:
            names = [name for name in CAPTIONS if _has(record, name)]
            links = {name: self._embedded(id, name) for name in names}
        return report_page(record, links)

    def page(
        self, limit: int, cursor: str | None = None, newest_first: bool = True, capture: str | None = None
    ) -> Page[StoredReconstruction]:
        """Reconstructions in the order of their making, of one capture where it is given; raises CursorError."""
        keep = None if capture is None else (lambda facts: facts[0] == capture)
        return self._index.page(limit, cursor, newest_first=newest_first, keep=keep)

    def delete(self, id: str) -> None:
        """Delete a reconstruction with all its files; raises InvalidIdError and NotFoundError."""
        self._index.delete(id)

    def _embedded(self, id: str, name: str) -> str:
        try:
            return embedded(self.artefact(id, name))
        except OSError as error:
            raise _fault(id, self._index.path(id), error) from error

    def _record(self, id: str) -> ReconstructionRecord:
        stored = self._index.get(id)
        if stored.record is None:
            raise DamagedError(KIND, id, stored.damaged or "it has no record")
        return stored.record

    def _make(self, artefact: Artefact, id: str, folder: Path, path: Path) -> None:
        """Write beside the stores and rename: what a killed process leaves is swept without a look into each folder."""
        output = self._work / f"{uuid.uuid4().hex}{path.suffix}"
        try:
            with self._space.writing(f"{artefact} of {KIND} '{id}'", 0):
                make_artefact(artefact, folder, output)
                output.replace(path)
        except DiskFullError:
            raise
        except DuofringeError as error:
            if folder.is_dir() and not isinstance(error, ReconstructionError):
                raise
            raise _fault(id, folder, error) from error
        finally:
            output.unlink(missing_ok=True)


def _has(record: ReconstructionRecord, artefact: str) -> bool:
    if artefact not in PHASE_ARTEFACTS:
        return True
    carrier, side = PHASE_ARTEFACTS[artefact]
    return carrier in record.phases.get(side, ())


def _facts(stored: StoredReconstruction) -> Facts | None:
    return None if stored.record is None else (stored.record.capture,)


def _describe(id: str, path: Path) -> StoredReconstruction:
    try:
        record = ReconstructionRecord.model_validate(json.loads((path / RECORD_NAME).read_text(encoding="utf-8")))
        for name in (POINTS_FILE, PHASES_FILE):
            (path / name).stat()
        return StoredReconstruction(id=id, created=record.created, record=record, bytes_on_disk=size_of(path))
    except (OSError, ValueError, RecursionError) as error:
        fault = _fault(id, path, error)
        if isinstance(fault, NotFoundError):
            raise fault from error
        return StoredReconstruction(
            id=id, created=time_of(id), record=None, bytes_on_disk=size_of(path), damaged=fault.reason
        )


def _fault(id: str, path: Path, error: Exception) -> NotFoundError | DamagedError:
    """What a failure to read amounts to: the folder is gone, or it is damaged."""
    if not path.is_dir():
        return NotFoundError(KIND, id)
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return DamagedError(KIND, id, f"{RECORD_NAME}: {'.'.join(map(str, first['loc']))}: {first['msg']}")
    if isinstance(error, OSError):
        return DamagedError(KIND, id, f"{Path(str(error.filename)).name}: {error.strerror}")
    if isinstance(error, ReconstructionError):
        return DamagedError(KIND, id, str(error).replace(f"{path}/", ""))
    return DamagedError(KIND, id, f"{RECORD_NAME}: not readable as JSON ({error})")
