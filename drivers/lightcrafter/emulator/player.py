"""An emulated sequence: which exposure shows which bits of which image, and when."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.lightcrafter.emulator.flash import EmulatedFlash, FlashPixels
from drivers.lightcrafter.values import LutControl, LutEntry, Timing

_LEAD_US = 2000.0


@dataclass(frozen=True, eq=False)
class Exposure:
    """One pattern of a sequence as the mirrors show it.

    index: from the start of the sequence. image: what is in the buffer. stale: that is not what the LUT asks for, since
    its image had not come out of flash in time. at_us: when the pulse comes, after the first. lit_us, dark_us: how long
    the light is on, and then off until the next exposure.
    """

    index: int
    at_us: float
    entry: LutEntry
    image: int
    stale: bool
    flash: EmulatedFlash
    lit_us: float
    dark_us: float

    @property
    def levels(self) -> FlashPixels:
        """(rows, columns), 0..255."""
        levels = self.flash.shown(self.image, self.entry.number, self.entry.depth)
        return 255 - levels if self.entry.inverted else levels


OnPulse = Callable[[Exposure], None]
OnValid = Callable[[tuple[Exposure, ...]], None]


def exposures_of(
    entries: tuple[LutEntry, ...], images: tuple[int, ...], timing: Timing, flash: EmulatedFlash
) -> tuple[Exposure, ...]:
    """One pass through the LUT. The next image starts to load when the one before it is swapped in."""
    made: list[Exposure] = []
    swaps = 0
    swapped_us = 0.0
    shown = images[0]
    stale = False
    for index, entry in enumerate(entries):
        at_us = float(index * timing.period_us)
        if entry.swap:
            wanted = images[swaps]
            stale = swaps > 0 and swapped_us + flash.load_us(wanted) > at_us
            shown = shown if stale else wanted
            swaps, swapped_us = swaps + 1, at_us
        dark_us = float(timing.period_us - timing.exposure_us)
        made.append(Exposure(index, at_us, entry, shown, stale, flash, float(timing.exposure_us), dark_us))
    return tuple(made)


class Player:
    """Shows exposures in real time on a thread of its own, which ends with the sequence.

    Where exposures follow each other without dark, the trigger output stays high: one pulse for all.
    """

    def __init__(
        self,
        exposures: tuple[Exposure, ...],
        timing: Timing,
        control: LutControl,
        on_pulse: OnPulse,
        on_end: Callable[[], None],
    ) -> None:
        self._exposures = exposures
        self._timing = timing
        self._repeat = control.repeat
        self._on_pulse = on_pulse
        self._on_end = on_end
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._play, name="emulated projector", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def halt(self) -> None:
        """No pulse comes after this returns, unless it comes from the thread of the player itself."""
        self._halt.set()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def _play(self) -> None:
        begin_s = time.monotonic() + 1e-6 * _LEAD_US
        gapless = self._timing.period_us == self._timing.exposure_us
        passes = 0
        while True:
            for exposure in self._exposures:
                at_us = exposure.at_us + passes * len(self._exposures) * self._timing.period_us
                if self._halt.wait(max(0.0, begin_s + 1e-6 * at_us - time.monotonic())):
                    return
                if not gapless or (passes == 0 and exposure.index == 0):
                    self._on_pulse(exposure)
            passes += 1
            if not self._repeat:
                break
        end_us = len(self._exposures) * self._timing.period_us
        if not self._halt.wait(max(0.0, begin_s + 1e-6 * end_us - time.monotonic())):
            self._on_end()
