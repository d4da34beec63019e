"""When a pulse starts an exposure, and when it is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass

_ROW_US = 5.17
"""6.2 ms for 1,200 rows."""
_DOUBLED_AFTER_S = 20e-6


@dataclass(frozen=True)
class Exposure:
    """Times in seconds, ``time.monotonic``. index: of the pulse. block: id of the frame."""

    index: int
    block: int
    start_s: float
    read_s: float
    exposure_us: float
    gain_db: float


class Sensor:
    """Counts pulses and exposures since acquisition started; not safe against threads."""

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Count anew."""
        self.pulses = 0
        self._exposures = 0
        self._exposed_s = self._read_s = -math.inf

    def takes(self, now_s: float, *, overlap: bool) -> bool:
        """Whether a pulse at ``now_s`` would be taken."""
        return now_s >= (self._exposed_s if overlap else self._read_s)

    def expose(self, now_s: float, exposure_us: float, gain_db: float, rows: int, *, overlap: bool) -> Exposure | None:
        """A pulse at ``now_s``; None where the sensor is busy.

        overlap: during readout a pulse is taken, but the exposure ends no earlier than that readout.
        """
        return self._begin(now_s, exposure_us, gain_db, rows) if self.takes(now_s, overlap=overlap) else None

    def bounce(self, first: Exposure, rows: int) -> Exposure:
        """A second exposure for the same pulse."""
        return self._begin(first.start_s + _DOUBLED_AFTER_S, first.exposure_us, first.gain_db, rows)

    def _begin(self, now_s: float, exposure_us: float, gain_db: float, rows: int) -> Exposure:
        start_s = max(now_s, self._read_s - 1e-6 * exposure_us)
        self._exposed_s = start_s + 1e-6 * exposure_us
        self._read_s = self._exposed_s + 1e-6 * _ROW_US * rows
        self._exposures += 1
        block = (self._exposures - 1) % 0xFFFF + 1  # 16 bits, never 0
        return Exposure(self.pulses - 1, block, start_s, self._read_s, exposure_us, gain_db)
