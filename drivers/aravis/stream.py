"""Frames as the library hands them over, from one arming to the next disarming."""

from __future__ import annotations

import contextlib
import ctypes

import numpy as np

from drivers.aravis.library import AravisError, Library
from drivers.genicam.connection import ENDLESS_BUFFERS, SPARE_BUFFERS, FrameIds, Received, unpack_mono16
from models.capture import Image

_WHOLE = 0
_NEVER_A_FRAME = (1, 6, 7)
_STATUS = {
    -1: "unknown",
    2: "the rest of it did not come in time",
    3: "packets are missing",
    4: "a packet has a wrong number",
    5: "its size is wrong",
    8: "it is no image",
}
_MONO8, _MONO16 = 0x0108_0001, 0x0110_0007
_WORTH_REPAIRING = 1.0
"""Share of a frame's packets that may be asked for again. The library's own choice, a quarter, gives up a frame that
lost half of its packets to a short stall of the receiver."""
_RETENTION_US = 300_000.0
"""How long a frame waits for its missing packets; the library's own 100 ms are short on a busy computer."""
_ORDINARY_SOCKET = 1
"""ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED. The packet socket, which root gets, was seen deaf after some armings."""


class AravisStream:
    """One of the library's streams; a fresh one for each arming, since an old one discards ids that start anew.

    Not safe against threads. Raises AravisError where it cannot be made.
    """

    def __init__(self, library: Library, camera: int, frames: int | None, ids: FrameIds, *, gige: bool) -> None:
        self._library, self._camera = library, camera
        self._ids = ids
        self.delivered = 0
        payload = library.call("camera_get_payload", camera)
        if gige:
            library.call("camera_gv_set_stream_options", camera, _ORDINARY_SOCKET)
        self._handle: int = library.call("camera_create_stream", camera, None, None)
        if not self._handle:
            raise AravisError("device", 4, "the library made no stream")
        if gige:
            library.set_number(self._handle, "packet-request-ratio", _WORTH_REPAIRING)
            library.set_number(self._handle, "frame-retention", _RETENTION_US)
        for _ in range(ENDLESS_BUFFERS if frames is None else frames + SPARE_BUFFERS):
            library.call("stream_push_buffer", self._handle, library.call("buffer_new_allocate", payload))

    def start(self) -> None:
        self._library.call("camera_start_acquisition", self._camera)

    def pop(self, timeout_us: int) -> Received | None:
        while True:
            buffer = self._library.call("stream_timeout_pop_buffer", self._handle, timeout_us)
            if not buffer:
                return None
            try:
                received = self._receive(buffer)
            finally:
                self._library.call("stream_push_buffer", self._handle, buffer)
            if received is not None:
                return received

    def end(self, *, dead: bool) -> int:
        if not dead:
            stop(self._library, self._camera)
        left = 0
        while buffer := self._library.call("stream_try_pop_buffer", self._handle):
            received = self._receive(buffer)
            left += received is not None and received.image is not None
            self._library.release(buffer)
        (self._library.release_later if dead else self._library.release)(self._handle)
        return left

    @property
    def lost(self) -> int:
        return self._ids.missing

    def _receive(self, buffer: int) -> Received | None:
        call = self._library.call
        status = call("buffer_get_status", buffer)
        if status in _NEVER_A_FRAME:
            return None
        number = self._ids.count(call("buffer_get_frame_id", buffer))
        times = (call("buffer_get_timestamp", buffer), call("buffer_get_system_timestamp", buffer))
        if status != _WHOLE:
            return Received(number, *times, problem=_STATUS.get(status, f"status {status}"))
        size = ctypes.c_size_t()
        data = call("buffer_get_data", buffer, ctypes.byref(size))
        width, height = call("buffer_get_image_width", buffer), call("buffer_get_image_height", buffer)
        pixels = np.ctypeslib.as_array((ctypes.c_uint8 * size.value).from_address(data))
        image = _as_image(pixels, width, height, call("buffer_get_image_pixel_format", buffer))
        return Received(number, *times, image=image, problem="" if image is not None else "its size or format is wrong")


def _as_image(pixels: np.ndarray, width: int, height: int, pixel_format: int) -> Image | None:
    """A copy: the library will write into the buffer again."""
    if pixel_format == _MONO8 and pixels.size >= width * height:
        return pixels[: width * height].reshape(height, width).copy()
    if pixel_format == _MONO16 and pixels.size >= 2 * width * height:
        wide = pixels[: 2 * width * height].view("<u2").reshape(height, width)
        return unpack_mono16(wide)
    return None


def stop(library: Library, camera: int) -> None:
    """Stop acquisition; a camera that does not listen any more stops by itself."""
    with contextlib.suppress(AravisError):
        library.call("camera_stop_acquisition", camera)
