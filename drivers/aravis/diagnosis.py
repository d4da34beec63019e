"""What can be told of the camera library, and of how an open camera is attached."""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

from drivers.aravis.library import PATH_VARIABLE, load_library
from drivers.camera import CameraState
from drivers.errors import DeviceStateError
from drivers.genicam.camera import GenicamCamera

_MAPS = Path("/proc/self/maps")
_PARTS = ("major", "minor", "micro")
_USB_SPEEDS = {"LowSpeed": 1.5e6, "FullSpeed": 12e6, "HighSpeed": 480e6, "SuperSpeed": 5e9}
_LEAST_SPEED = {"USB3Vision": 4e9, "GigEVision": 0.8e9}
"""Of a link with room for triggered images; USB 3 may be told with or without its coding, 5 or 4 Gbit/s."""
_V = TypeVar("_V", str, int, float)


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


@dataclass(frozen=True)
class CameraLink:
    """How a camera is attached.

    protocol: "USB3Vision" or "GigEVision". bits_per_s: of the link; None where the camera does not tell.
    transmit_failures: frames that the camera could not get rid of since it was switched on; None likewise.
    """

    protocol: str
    bits_per_s: float | None = None
    transmit_failures: int | None = None

    @property
    def slow(self) -> bool:
        """Whether it is known to be too slow for triggered images."""
        return self.bits_per_s is not None and self.bits_per_s < _LEAST_SPEED[self.protocol]


class Readable(Protocol):
    """Features of a camera that can be asked for."""

    def has(self, name: str) -> bool:
        """Whether the camera has the feature."""
        ...

    def read(self, name: str, kind: type[_V]) -> _V:
        """What it holds."""
        ...


def loaded_library(path: str | None = None) -> LoadedLibrary:
    """Load libaravis as the cameras do, and tell where it lies and which release it is.

    Raises DeviceUnavailableError where it cannot be loaded.
    """
    load_library("camera", path)
    wanted = path or os.environ.get(PATH_VARIABLE) or ""
    file = Path(wanted).resolve() if "/" in wanted else _mapped("libaravis")
    return LoadedLibrary(file, None if file is None else _version(file))


def examine_camera(camera: GenicamCamera) -> CameraLink:
    """The link of an open camera, whatever library reaches it.

    Raises DeviceStateError while it is closed, DeviceLostError where it is gone.
    """
    with camera._lock:
        connection = camera._connection
        if connection is None or camera.state is CameraState.FAULT:
            raise DeviceStateError(camera.name, f"cannot tell how it is attached while it is {camera.state}")
        return link_of(connection.features, "GigEVision" if connection.gige else "USB3Vision")


def link_of(features: Readable, protocol: str) -> CameraLink:
    """What the features tell of the link.

    U3VCurrentSpeed is a word on USB3 Vision cameras; DeviceLinkSpeed counts bytes/s (SFNC 2.7, device control).
    """
    failures = features.read("TransmitFailureCount", int) if features.has("TransmitFailureCount") else None
    bits_per_s = None
    if features.has("U3VCurrentSpeed"):
        word = features.read("U3VCurrentSpeed", str)
        bits_per_s = 10e9 if word.startswith("SuperSpeedPlus") else _USB_SPEEDS.get(word)
    elif features.has("DeviceLinkSpeed"):
        bits_per_s = 8.0 * features.read("DeviceLinkSpeed", int)
    return CameraLink(protocol, bits_per_s, failures)


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
