"""Which libaravis this process has loaded."""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from drivers.aravis.library import PATH_VARIABLE, load_library

_MAPS = Path("/proc/self/maps")
_PARTS = ("major", "minor", "micro")


class LibraryVersion(NamedTuple):
    """A release of libaravis."""

    major: int
    minor: int
    micro: int

    def __str__(self) -> str:
        return ".".join(map(str, self))


@dataclass(frozen=True)
class LoadedLibrary:
    """The camera library in this process. path, version: None where they cannot be found out."""

    path: Path | None
    version: LibraryVersion | None


def loaded_library(path: str | None = None) -> LoadedLibrary:
    """Load libaravis as the cameras do, and tell where it lies and which release it is.

    Raises DeviceUnavailableError where it cannot be loaded.
    """
    load_library("camera", path)
    wanted = path or os.environ.get(PATH_VARIABLE) or ""
    file = Path(wanted).resolve() if "/" in wanted else _mapped("libaravis")
    return LoadedLibrary(file, None if file is None else _version(file))


def _mapped(name: str) -> Path | None:
    """The first file so called in this process's memory."""
    try:
        lines = _MAPS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    files = (Path(line[line.index("/") :]) for line in lines if "/" in line)
    return next((file for file in files if file.name.startswith(name)), None)


def _version(file: Path) -> LibraryVersion | None:
    try:
        library = ctypes.CDLL(str(file))
        return LibraryVersion(*(int(getattr(library, f"arv_get_{part}_version")()) for part in _PARTS))
    except (OSError, AttributeError):  # a build without these functions works all the same
        return None
