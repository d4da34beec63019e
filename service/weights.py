"""The refiner's weights by name: those of the package, and those in the service's own folder."""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass
from pathlib import Path

from models.refiner.errors import RefinerError
from models.refiner.extractor import RefinedFourierTransform
from models.refiner.shipped import DEFAULT, find_weights, shipped_names
from models.refiner.weights import RECORD_NAME, TENSORS_NAME, WeightsRecord
from service.compute import ComputeLane

NAME_PATTERN = r"^[a-z0-9][a-z0-9_.+-]{0,63}$"
"""Of weights in a request: no separator, so that a name leads out of no folder."""
_Version = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class NamedWeights:
    """Weights that can be read. folder: where they lie; clients see the name alone."""

    name: str
    folder: Path
    record: WeightsRecord

    def require_periods(self, periods: tuple[float, ...]) -> None:
        """Raise RefinerError, which names the weights, unless they are for fringes of these periods."""
        self.record.require_periods(periods, Path(self.name))


class WeightsShelf:
    """Shipped weights and those of one folder, which need not exist; may be used by many threads.

    A shipped name goes before the same name in the folder. What was read is remembered until its files change.
    """

    def __init__(self, folder: Path, compute: ComputeLane) -> None:
        self.folder = folder
        self._compute = compute
        self._known: dict[Path, tuple[_Version, WeightsRecord | str]] = {}
        self._lock = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """All that ``get`` takes, the default first."""
        own = {path.parent.name for path in self.folder.glob(f"*/{RECORD_NAME}")}
        shipped = shipped_names()
        return (*shipped, *sorted(name for name in own - set(shipped) if re.fullmatch(NAME_PATTERN, name)))

    def get(self, name: str | None = None) -> NamedWeights:
        """Weights by name, None for the default; not from within the compute lane, which reads them.

        Raises RefinerError for a name of nothing and for damaged weights, ComputeBusyError.
        """
        name = DEFAULT if name is None else name
        folder = self._folder_of(name)
        version = _version(folder)
        with self._lock:
            known = self._known.get(folder)
        if known is None or known[0] != version:
            known = (version, self._read(folder))
            with self._lock:
                self._known[folder] = known
        _, found = known
        if isinstance(found, str):
            raise RefinerError(found.replace(str(folder), name))
        return NamedWeights(name, folder, found)

    def fault(self) -> str | None:
        """Why the default weights do not serve, as found when they were last asked for, or None."""
        folder = find_weights()
        with self._lock:
            _, found = self._known.get(folder, (None, None))
        return found.replace(str(folder), DEFAULT) if isinstance(found, str) else None

    def _folder_of(self, name: str) -> Path:
        if name == DEFAULT:
            return find_weights()
        if name in shipped_names():
            return find_weights(name)
        if name not in self.names:
            raise RefinerError(f"weights '{name}' are unknown; there are {', '.join(self.names) or 'none'}")
        return self.folder / name

    def _read(self, folder: Path) -> WeightsRecord | str:
        """Their record, or why there is none."""
        try:
            return self._compute.submit(lambda: RefinedFourierTransform(weights=str(folder)).record).result()
        except RefinerError as error:
            return str(error)


def _version(folder: Path) -> _Version:
    """Tells apart what took one another's place at a path; (0, 0) for a file that is not there."""
    found = []
    for name in (RECORD_NAME, TENSORS_NAME):
        try:
            status = (folder / name).stat()
            found.append((status.st_mtime_ns, status.st_size))
        except OSError:
            found.append((0, 0))
    return tuple(found)
