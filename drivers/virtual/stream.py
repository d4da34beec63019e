"""What a virtual camera delivers between arming and disarming."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass

from drivers.camera import Frame, StreamStatistics
from drivers.errors import IncompleteFrameError


@dataclass(frozen=True, eq=False)
class _Arrival:
    content: Frame | IncompleteFrameError
    due_s: float


class Stream:
    """Frames in order of arrival; not safe against threads, the camera's lock guards it.

    exposures: begun since arming, whatever became of them. delivered: handed to the caller.
    """

    def __init__(self) -> None:
        self.exposures = 0
        self.delivered = 0
        self._lost = 0
        self._arrivals: deque[_Arrival] = deque()

    @property
    def due_s(self) -> float | None:
        """When the next arrival has come, ``time.monotonic``; None where nothing is on its way."""
        return self._arrivals[0].due_s if self._arrivals else None

    def behind(self, due_s: float) -> float:
        """``due_s``, or later where something that comes later is on its way already."""
        return max(due_s, self._arrivals[-1].due_s) if self._arrivals else due_s

    def put(self, content: Frame | IncompleteFrameError, due_s: float) -> None:
        self._arrivals.append(_Arrival(content, due_s))

    def lose(self) -> None:
        """A frame that was exposed and never arrives."""
        self._lost += 1

    def claim(self) -> Frame:
        """The next arrival; raises the IncompleteFrameError that it may be."""
        content = self._arrivals.popleft().content
        if isinstance(content, IncompleteFrameError):
            raise content
        self.delivered += 1
        return content

    def statistics(self) -> StreamStatistics:
        """As the stream ends now: what has not arrived by then never will."""
        now = time.monotonic()
        whole = [a for a in self._arrivals if isinstance(a.content, Frame)]
        came = sum(a.due_s <= now for a in whole)
        return StreamStatistics(self.delivered, came, self._lost + len(whole) - came)
