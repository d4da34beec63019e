"""An emulated sequence: which exposure shows which bits of which image, and when."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from drivers.lightcrafter.emulator.flash import EmulatedFlash, FlashPixels
from drivers.lightcrafter.values import LutEntry, Timing

_LEAD_US = 2000.0


class Images(Protocol):
    """Where the controller takes bit planes from."""

    def shown(self, index: int, number: int, depth: int) -> FlashPixels:
        """Levels on the mirrors (rows, columns), 0..255."""
        ...


@dataclass(frozen=True, eq=False)
class Exposure:
    """One pattern of a sequence as the mirrors show it.

    index: from the start of the sequence, or of the video frame. image: what is in the buffer, below 0 for a frame.
    stale: that is not what the LUT asks for, since its image had not come out of flash in time. images: where it comes
    from. at_us: when the pulse comes, after the first. lit_us, dark_us: how long the light is on, and then off until
    the next exposure.
    """

    index: int
    at_us: float
    entry: LutEntry
    image: int
    stale: bool
    images: Images
    lit_us: float
    dark_us: float

    @property
    def levels(self) -> FlashPixels:
        """(rows, columns), 0..255."""
        levels = self.images.shown(self.image, self.entry.number, self.entry.depth)
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

    passes: the exposures from each start of the LUT to its end, asked for as the pass begins; none ends the sequence.
    pass_us: from the start of one to the next.
    """

    def __init__(
        self,
        passes: Iterator[tuple[Exposure, ...]],
        pass_us: float,
        on_show: Callable[[Exposure], None],
        on_end: Callable[[], None],
    ) -> None:
        self._passes = passes
        self._pass_us = pass_us
        self._on_show = on_show
        self._on_end = on_end
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._play, name="emulated projector", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def halt(self) -> None:
        """Nothing is shown after this returns, unless it comes from the thread of the player itself."""
        self._halt.set()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def _play(self) -> None:
        begin_s = time.monotonic() + 1e-6 * _LEAD_US
        for count in itertools.count():
            pass_s = begin_s + 1e-6 * count * self._pass_us
            if self._halted_before(pass_s):
                return
            exposures = next(self._passes, ())
            if not exposures:
                break
            for exposure in exposures:
                if self._halted_before(pass_s + 1e-6 * exposure.at_us):
                    return
                self._on_show(exposure)
        self._on_end()

    def _halted_before(self, time_s: float) -> bool:
        return self._halt.wait(max(0.0, time_s - time.monotonic()))
