"""Frames as Spinnaker hands them over, from one arming to the next disarming."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.errors import DeviceConfigurationError
from drivers.genicam.connection import ENDLESS_BUFFERS, SPARE_BUFFERS, FrameIds, Received, unpack_mono16
from drivers.genicam.features import Features
from drivers.spinnaker.library import IO, TIMEOUT, CameraHandle, SpinnakerError
from models.capture import Image

_USB_MEMORY = Path("/sys/module/usbcore/parameters/usbfs_memory_mb")
_STATUS = {
    -1: "unknown",
    1: "its checksum is wrong",
    2: "it is larger than its buffer",
    3: "packets are missing",
    4: "its beginning is damaged",
    5: "its end is damaged",
    6: "a packet has a wrong number",
    7: "its beginning is missing",
    8: "its end is missing",
    9: "the rest of it did not come in time",
    10: "its information contradicts itself",
    11: "its chunk data are invalid",
    12: "the system had no resources left",
}
"""Numbers of Spinnaker::ImageStatus."""


class SpinnakerStream:
    """Not safe against threads. settings: features of the host's side of the stream.

    Raises DeviceConfigurationError where so many frames cannot be held.
    """

    def __init__(
        self, handle: CameraHandle, settings: Features, device: str, frames: int | None, ids: FrameIds
    ) -> None:
        self._handle, self._device = handle, device
        self._ids = ids
        self._buffers = ENDLESS_BUFFERS if frames is None else frames + SPARE_BUFFERS
        self.delivered = 0
        settings.write("StreamBufferHandlingMode", "OldestFirst")
        if settings.offers("StreamBufferCountMode", "Manual"):
            settings.write("StreamBufferCountMode", "Manual")
        _, most, _ = settings.integer_range("StreamBufferCountManual")
        if self._buffers > most:
            raise DeviceConfigurationError(device, "frames", frames, f"Spinnaker holds at most {most} at once")
        settings.write("StreamBufferCountManual", self._buffers)

    def start(self) -> None:
        """Raises DeviceConfigurationError, naming the cure, where the system gives the USB too little memory."""
        try:
            self._handle.call("BeginAcquisition")
        except SpinnakerError as error:
            if error.code != IO:
                raise
            raise DeviceConfigurationError(
                self._device,
                "acquisition",
                "started",
                f"the camera says: {error}; the memory of usbfs is mostly too small, {_usb_memory()}; "
                f"write 1000 into {_USB_MEMORY}",
            ) from error

    def pop(self, timeout_us: int) -> Received | None:
        try:
            image = self._handle.call("GetNextImage", -(-timeout_us // 1000))
        except SpinnakerError as error:
            if error.code == TIMEOUT:
                return None
            raise
        spinnaker = self._handle.spinnaker
        try:
            received: Received = spinnaker.call(self._receive, image, time.time_ns())
        finally:
            with suppress(SpinnakerError):
                spinnaker.call(image.Release)
            del image  # who keeps the error would keep the image
        return received

    def end(self, *, dead: bool) -> int:
        """What is left is lost when acquisition ends, and thus counted before."""
        del dead
        left = 0
        with suppress(SpinnakerError):
            for _ in range(self._buffers):
                received = self.pop(0)
                if received is None:
                    break
                left += received.image is not None
        with suppress(SpinnakerError):
            self._handle.call("EndAcquisition")
        return left

    @property
    def lost(self) -> int:
        return self._ids.missing

    def _receive(self, image: Any, system_ns: int) -> Received:
        number = self._ids.count(int(image.GetFrameID()))
        times = (int(image.GetTimeStamp()), system_ns)
        if image.IsIncomplete():
            status = int(image.GetImageStatus())
            return Received(number, *times, problem=_STATUS.get(status, f"status {status}"))
        pixels = _pixels(image)
        return Received(number, *times, image=pixels, problem="" if pixels is not None else "its format is wrong")


def _pixels(image: Any) -> Image | None:
    """A copy: the library will write into the buffer again."""
    name = image.GetPixelFormatName()
    if name == "Mono8":
        copy: Image = image.GetNDArray().copy()
        return copy
    return unpack_mono16(image.GetNDArray()) if name == "Mono16" else None


def _usb_memory() -> str:
    try:
        return f"{_USB_MEMORY.read_text().strip()} MB"
    except OSError:
        return "16 MB where nobody set it"
