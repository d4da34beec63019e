"""What a driver's library must offer for the camera in drivers/genicam/camera.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.genicam.features import Features
from models.capture import Image

SPARE_BUFFERS = 4
"""Beyond the frames expected, so that extra ones are seen."""
ENDLESS_BUFFERS = 32
_GIGE_IDS = 0xFFFF
"""Ids of GigE Vision run from 1 to this and then from 1 again."""


class LibraryError(Exception):
    """What a library reports; GenicamCamera turns it into a DriverError."""


@dataclass(frozen=True, eq=False)
class Received:
    """image: None where the frame is damaged; ``problem`` says how. frame_id: from 0. Times in ns.

    device_ns: the camera's clock. system_ns: arrival, ``time.time_ns``.
    """

    frame_id: int
    device_ns: int
    system_ns: int
    image: Image | None = None
    problem: str = ""


class FrameStream(Protocol):
    """Frames from one arming to the next disarming. Not safe against threads; may raise LibraryError."""

    delivered: int
    """How many the caller has been given; GenicamCamera counts."""

    @property
    def lost(self) -> int:
        """Frames that never came, as their ids tell."""
        ...

    def start(self) -> None:
        """Begin acquisition."""
        ...

    def pop(self, timeout_us: int) -> Received | None:
        """The next arrival, None where nothing comes in time."""
        ...

    def end(self, *, dead: bool) -> int:
        """Stop acquisition and let go; how many whole frames were left. Never raises. dead: expect no answer."""
        ...


class Connection(Protocol):
    """A camera that is held open, and stands still."""

    @property
    def features(self) -> Features: ...

    @property
    def gige(self) -> bool:
        """Whether it is a camera of GigE Vision, else of USB3 Vision."""
        ...

    @property
    def simulated(self) -> bool:
        """Whether a program stands in for the camera."""
        ...

    @property
    def control_lost(self) -> bool:
        """Whether the library has found out by itself that the camera is gone."""
        ...

    def is_alive(self) -> bool:
        """Whether the camera answers and is still ours; below a second where it does not. Never raises."""
        ...

    def make_stream(self, frames: int | None, ids: FrameIds) -> FrameStream:
        """Room for so many frames and some more, None for endless."""
        ...

    def release(self, *, dead: bool = False) -> None:
        """Let go of it. Never raises. dead: do not wait for its answers."""
        ...


class FrameIds:
    """Turns ids that may start at 1 and wrap into a count from 0.

    first: what a camera that is not of GigE Vision gives the first frame after arming.
    """

    def __init__(self, *, gige: bool, first: int = 0) -> None:
        self._gige = gige
        self._first = first
        self._last = -1
        self._seen = 0
        self._highest = -1

    def count(self, raw: int) -> int:
        """``raw`` comes within half a round of the last one."""
        if not self._gige:
            number = raw - self._first
        else:
            ahead = (raw - 1 - self._last + _GIGE_IDS // 2) % _GIGE_IDS - _GIGE_IDS // 2
            number = self._last + ahead
        self._last = number
        self._seen += 1
        self._highest = max(self._highest, number)
        return number

    @property
    def missing(self) -> int:
        """Ids before the highest that never came."""
        return max(0, self._highest + 1 - self._seen)


def unpack_mono16(pixels: Image) -> Image:
    """The 12 bits of a Mono16 image, of which a Grasshopper3 fills the upper ones; a copy."""
    return (pixels >> 4).astype(np.uint16)
