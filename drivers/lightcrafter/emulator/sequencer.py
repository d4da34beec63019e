"""The part of an emulated controller that shows one pattern after the other."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from drivers.lightcrafter.emulator.player import Exposure, OnPulse, Player
from drivers.lightcrafter.sequence import VIDEO_FRAME_US
from drivers.lightcrafter.values import LutControl, Timing

Frames = Callable[[], tuple[Exposure, ...]]
"""The exposures of the video frame that begins now; none where no signal comes."""


class Sequencer:
    """on_pulse, realtime: as of EmulatedController. on_end: called when a sequence has come to its own end.

    showing: the pattern that stands on the mirrors. pulses_sent: of the trigger output, ever.
    """

    def __init__(self, on_pulse: OnPulse | None, on_end: Callable[[], None], *, realtime: bool) -> None:
        self.showing: Exposure | None = None
        self.pulses_sent = 0
        self._on_pulse = on_pulse
        self._on_end = on_end
        self._realtime = realtime
        self._player: Player | None = None
        self._left: list[Exposure] = []
        self._frames: Frames | None = None

    def play(self, exposures: tuple[Exposure, ...], timing: Timing, control: LutControl) -> None:
        """Where exposures follow each other without dark, the trigger output stays high: one pulse for all."""
        if not self._realtime:
            self._left = list(exposures)
            return
        gapless = timing.period_us == timing.exposure_us
        first = self.pulses_sent

        def show(exposure: Exposure) -> None:
            if gapless and self.pulses_sent > first:
                self.showing = exposure
            else:
                self._pulse(exposure)

        passes = itertools.repeat(exposures) if control.repeat else iter((exposures,))
        self._run(Player(passes, len(exposures) * timing.period_us, show, self._end))

    def follow(self, frames: Frames) -> None:
        """Show video frames, without a pulse, until one does not come."""
        if self._realtime:
            self._run(Player(iter(frames, ()), VIDEO_FRAME_US, self._stand, self._end))
        else:
            self._frames = frames

    def _run(self, player: Player) -> None:
        self._player = player
        player.start()

    def step(self) -> Exposure | None:
        """Show the next pattern, without real time; None where the sequence has ended."""
        if self._frames is not None:
            return self._step_of_video(self._frames)
        if not self._left:
            return None
        exposure = self._left.pop(0)
        self._pulse(exposure)
        if not self._left:
            self._end()
        return exposure

    def _step_of_video(self, frames: Frames) -> Exposure | None:
        self._left = self._left or list(frames())
        if not self._left:
            self._frames = None
            self._end()
            return None
        self._stand(self._left.pop(0))
        return self.showing

    def halt(self) -> None:
        """No pulse comes after this. Waits for the thread of the sequence: call it without a lock that one wants."""
        player, self._player = self._player, None
        if player is not None:
            player.halt()
        self._left, self._frames = [], None
        self.showing = None

    def _stand(self, exposure: Exposure) -> None:
        self.showing = exposure

    def _pulse(self, exposure: Exposure) -> None:
        self.showing = exposure
        self.pulses_sent += 1
        if self._on_pulse is not None:
            self._on_pulse(exposure)

    def _end(self) -> None:
        self.showing = None
        self._on_end()
