"""From the projector's trigger output to the cameras' inputs, and what may be wrong on the way."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Literal

from drivers.bench.sight import Sight
from drivers.gigevision import SimulatedGrasshopper, TriggerFaults
from drivers.gigevision.pictures import ImageMaker
from drivers.lightcrafter.emulator.player import Exposure
from drivers.virtual.faults import Faults, SequenceFaults
from drivers.virtual.light_faults import spoilt
from models.capture import Image
from models.geometry.rig import Side

LINE = "Line3"
_REPLUGGED_S = 1.0
"""A camera that died of a fault is plugged in again after this."""
_EARLY_S = 0.005
_DRIFT = 1.5
Edge = Literal["RisingEdge", "FallingEdge"]


class Wiring:
    """TRIG_OUT_1 on line 3 of both cameras.

    inverted: cameras whose line is low while a pattern is lit. cut: cameras that hear nothing. pulses_sent: by the
    projector while a camera listened.
    """

    def __init__(self, cameras: Mapping[Side, SimulatedGrasshopper], sight: Sight, faults: Faults) -> None:
        self.inverted: set[Side] = set()
        self.cut: set[Side] = set()
        self.pulses_sent = 0
        self._sight = sight
        self._faults = faults
        self._cameras = cameras
        self._sequence: tuple[Exposure, ...] = ()
        self._suffered = SequenceFaults()
        self._begin_s = 0.0
        self._timers: list[threading.Timer] = []

    def close(self) -> None:
        """Nothing happens any more after this returns."""
        for timer in self._timers:
            timer.cancel()
            if timer.ident is not None:
                timer.join()

    def on_valid(self, exposures: tuple[Exposure, ...]) -> None:
        """A sequence was validated, also that of a pattern to be held: have its images ready before it starts."""
        self._sequence = exposures
        self._sight.prepare(exposures)

    def on_start(self, side: Side) -> None:
        """A camera began to listen."""
        if self._cameras[side].hears(LINE) and self._faults.strike("early", side):
            self._later(_EARLY_S, lambda: self._cameras[side].pulse(LINE, image=self._sight.now(side)))

    def on_pulse(self, exposure: Exposure) -> None:
        """A pattern appears: the trigger output rises now and falls as the pattern ends."""
        if not any(camera.hears(LINE) for camera in self._cameras.values()):
            return
        if exposure.index == 0:
            self._begin_sequence(exposure)
        self.pulses_sent += 1
        if self._suffered.has("not_started"):
            return
        rises_s = self._begin_s + 1e-6 * exposure.at_us
        falls_s = rises_s + 1e-6 * exposure.lit_us
        for side, camera in self._cameras.items():
            if side in self.cut:
                continue
            if self._suffered.at("drifted", side, exposure.index):
                camera.set_feature("ExposureTime", _DRIFT * camera.feature("ExposureTime"))
            if self._suffered.at("dead_camera", side, exposure.index):
                self._later(_REPLUGGED_S, camera.plug)
            first, last = ("FallingEdge", "RisingEdge") if side in self.inverted else ("RisingEdge", "FallingEdge")
            camera.pulse(LINE, first, rises_s, self._lit(side, exposure))
            camera.pulse(LINE, last, falls_s, self._unlit(side, exposure))

    def _begin_sequence(self, first: Exposure) -> None:
        self._suffered = self._faults.begin_sequence() if first.dark_us > 0 else SequenceFaults()
        self._begin_s = time.monotonic()
        for side, camera in self._cameras.items():
            camera.plan_faults(_trigger_faults(self._suffered, side, len(self._sequence)))

    def _lit(self, side: Side, exposure: Exposure) -> ImageMaker:
        shown = self._sequence[self._suffered.order(side, len(self._sequence))[exposure.index]]
        return self._spoilt(side, exposure.index, lambda: self._sight.exposure(side, shown))

    def _unlit(self, side: Side, exposure: Exposure) -> ImageMaker:
        following = next(iter(self._sequence[exposure.index + 1 :]), None)
        return self._spoilt(side, exposure.index, lambda: self._sight.belated(side, following))

    def _spoilt(self, side: Side, index: int, make: Callable[[], Image]) -> ImageMaker:
        suffered = self._suffered

        def image(_index: int, _exposure_us: float, _gain_db: float) -> Image:
            return spoilt(make(), self._sight.white_level(side), side, index, suffered)

        return image

    def _later(self, delay_s: float, action: Callable[[], object]) -> None:
        self._timers = [timer for timer in self._timers if timer.is_alive()]
        timer = threading.Timer(delay_s, action)
        timer.daemon = True
        self._timers.append(timer)
        timer.start()


def _trigger_faults(suffered: SequenceFaults, side: Side, count: int) -> TriggerFaults:
    """Faults of a sequence as its camera has them."""
    late = {k: fault.delay_s for k in range(count) if (fault := suffered.at("late", side, k))}

    def struck(kind: Literal["dropped", "truncated", "doubled", "ignored"]) -> frozenset[int]:
        return frozenset(k for k in range(count) if suffered.at(kind, side, k))

    dead = (k for k in range(count) if suffered.at("dead_camera", side, k))
    return TriggerFaults(
        dropped=struck("dropped"),
        corrupt=struck("truncated"),
        delayed=late,
        doubled=struck("doubled"),
        ignored=struck("ignored"),
        dead_at=next(dead, None),
    )
