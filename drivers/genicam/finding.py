"""Which of the cameras that answer is meant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from drivers.errors import DeviceNotFoundError


class FoundCamera(NamedTuple):
    """id: the library's name for it. address: of IPv4, or the place on the USB.

    protocol: "USB3Vision" or "GigEVision".
    """

    id: str
    model: str
    serial: str
    address: str
    protocol: str


def pick_camera(found: Sequence[FoundCamera], device: str, serial: str | None) -> FoundCamera:
    """The camera with this serial number, or the only one there is. Raises DeviceNotFoundError for ``device``."""
    there = ", ".join(f"{camera.model} {camera.serial}" for camera in found) or "none"
    if serial is None:
        if len(found) != 1:
            raise DeviceNotFoundError(device, f"name one camera by its serial number; those that answer: {there}")
        return found[0]
    for camera in found:
        if same_serial(serial, camera.serial):
            return camera
    raise DeviceNotFoundError(
        device, f"no camera with the serial number {serial} answers; those that do: {there}; check cable and power"
    )


def same_serial(wanted: str, shown: str) -> bool:
    """On the USB, a serial number is often shown as hexadecimal digits."""
    if wanted.strip().lower() == shown.strip().lower():
        return True
    try:
        return int(wanted) == int(shown, 16)
    except ValueError:
        return False
