"""The part of an emulated controller that shows one pattern after the other."""

from __future__ import annotations

from collections.abc import Callable

from drivers.lightcrafter.emulator.player import Exposure, OnPulse, Player
from drivers.lightcrafter.values import LutControl, Timing


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

    def play(self, exposures: tuple[Exposure, ...], timing: Timing, control: LutControl) -> None:
        if self._realtime:
            self._player = Player(exposures, timing, control, self._pulse, self._end)
            self._player.start()
        else:
            self._left = list(exposures)

    def step(self) -> Exposure | None:
        """Show the next pattern, without real time; None where the sequence has ended."""
        if not self._left:
            return None
        exposure = self._left.pop(0)
        self._pulse(exposure)
        if not self._left:
            self._end()
        return exposure

    def halt(self) -> None:
        """No pulse comes after this. Waits for the thread of the sequence: call it without a lock that one wants."""
        player, self._player = self._player, None
        if player is not None:
            player.halt()
        self._left = []
        self.showing = None

    def _pulse(self, exposure: Exposure) -> None:
        self.showing = exposure
        self.pulses_sent += 1
        if self._on_pulse is not None:
            self._on_pulse(exposure)

    def _end(self) -> None:
        self.showing = None
        self._on_end()
