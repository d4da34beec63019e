"""How an open camera is attached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

from drivers.genicam.camera import GenicamCamera

_USB_SPEEDS = {"LowSpeed": 1.5e6, "FullSpeed": 12e6, "HighSpeed": 480e6, "SuperSpeed": 5e9}
_LEAST_SPEED = {"USB3Vision": 4e9, "GigEVision": 0.8e9}
"""Of a link with room for triggered images; USB 3 may be told with or without its coding, 5 or 4 Gbit/s."""
_V = TypeVar("_V", str, int, float)


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


def examine_camera(camera: GenicamCamera) -> CameraLink:
    """The link of an open camera, whatever library reaches it.

    Raises DeviceStateError while it is closed, DeviceLostError where it is gone.
    """
    with camera.asked() as connection:
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
