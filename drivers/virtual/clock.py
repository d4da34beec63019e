"""Time on a virtual rig."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass


class BenchTime:
    """Microseconds since the rig was made.

    In real time they pass as on the wall; otherwise a sequence takes no time, and its duration is skipped at its end.
    """

    def __init__(self, *, realtime: bool) -> None:
        self.realtime = realtime
        self._zero_s = time.monotonic()
        self._skipped_us = 0.0
        self._lock = threading.Lock()

    def now_us(self) -> float:
        with self._lock:
            return self._now_us()

    def _now_us(self) -> float:
        return (time.monotonic() - self._zero_s) * 1e6 + self._skipped_us

    def reach(self, at_us: float) -> None:
        """Let it be at least ``at_us``, where time need not pass for that."""
        if not self.realtime:
            with self._lock:
                self._skipped_us += max(0.0, at_us - self._now_us())

    def comes_s(self, at_us: float) -> float:
        """When ``at_us`` comes on ``time.monotonic``: at once where time does not matter."""
        return self._zero_s + at_us * 1e-6 if self.realtime else time.monotonic()


@dataclass(frozen=True)
class DeviceClock:
    """A camera's own clock, which runs freely. drift_ppm: by how much it is fast, parts per million."""

    offset_ns: int
    drift_ppm: float

    def ns(self, at_us: float) -> int:
        return self.offset_ns + round(at_us * 1000 * (1 + self.drift_ppm * 1e-6))
