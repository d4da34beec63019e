"""What lies between a virtual projector and two virtual cameras: the trigger line, the scene, the time, the faults."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal, Protocol

from drivers.camera import AppliedSettings
from drivers.projector import LoadedSequence
from drivers.sequence_rules import unstored
from drivers.virtual.clock import BenchTime
from drivers.virtual.faults import Faults, PlantedFault, SequenceFaults
from drivers.virtual.light_faults import spoilt
from drivers.virtual.source import SceneSource
from models.capture import Image
from models.geometry.rig import Side
from models.patterns import Pattern, PatternPlan

Delivery = Literal["whole", "dropped", "truncated"]
_DOUBLED_AFTER_US = 100.0


class EdgeReceiver(Protocol):
    """The end of the trigger line in a camera."""

    @property
    def edge_settings(self) -> AppliedSettings | None:
        """What a camera holds that is armed for pulses; None while it is not."""
        ...

    def on_edge(
        self, at_us: float, image: Image, *, delivery: Delivery = "whole", delay_s: float = 0.0, forced: bool = False
    ) -> None:
        """A pulse at bench time ``at_us``; ``forced`` ones neither mind that the camera is busy nor make it so."""
        ...

    def die(self) -> None: ...

    def drift(self) -> None: ...


@dataclass(eq=False)
class _Batch:
    """The images that one camera will take of a sequence, and what they were made for."""

    plan: PatternPlan
    settings: AppliedSettings
    brightness: float
    scene: str
    images: tuple[Image, ...]
    used: bool = False

    def fits(self, plan: PatternPlan, settings: AppliedSettings, brightness: float, scene: str) -> bool:
        made_for = (self.plan, self.settings, self.brightness, self.scene)
        return not self.used and made_for == (plan, settings, brightness, scene)


class Bench:
    """Hands pulses and images to the cameras.

    All images of a sequence are made when the cameras are armed, so that none is late for being slow to make.
    shown: the pattern that the projector holds. sequence: what it has loaded. brightness: of its lamp, 0..1.
    pulses_sent: on the trigger line, since the rig was made.
    """

    def __init__(self, source: SceneSource, faults: Faults, time: BenchTime) -> None:
        self.source = source
        self.faults = faults
        self.time = time
        self.shown: Pattern | None = None
        self.sequence: LoadedSequence | None = None
        self.brightness = 1.0
        self.pulses_sent = 0
        self._lock = threading.RLock()
        self._receivers: dict[Side, EdgeReceiver] = {}
        self._batches: dict[Side, _Batch] = {}
        self._shots: dict[Side, int] = {}

    def plant(self, fault: PlantedFault) -> None:
        """Have a fault from the next sequence on."""
        self.faults.plant(fault)

    def clear_faults(self) -> None:
        self.faults.clear()

    def attach(self, side: Side, receiver: EdgeReceiver) -> None:
        """Connect a camera to the trigger line."""
        self._receivers[side] = receiver

    def get_ready(self) -> None:
        """Make the images of the loaded sequence for each armed camera whose images do not fit any more."""
        with self._lock:
            sequence = self.sequence
            if sequence is None or unstored(sequence.plan, self.source.projector_info.stored) is not None:
                return
            for side, receiver in self._receivers.items():
                settings = receiver.edge_settings
                if settings is not None:
                    self._make_batch(side, sequence.plan, settings)

    def _make_batch(self, side: Side, plan: PatternPlan, settings: AppliedSettings) -> None:
        made, scene = self._batches.get(side), self.source.scene
        if made is not None and made.fits(plan, settings, self.brightness, scene):
            return
        shot = self._shots.get(side, 0)
        images = [
            self.source.image(
                side,
                pattern,
                settings,
                lit_us=min(settings.exposure_us, pattern.exposure_us or settings.exposure_us),
                brightness=self.brightness,
                shot=shot,
            )
            for pattern in plan.patterns
        ]
        self._batches[side] = _Batch(plan, settings, self.brightness, scene, tuple(images))

    def view(self, side: Side, settings: AppliedSettings) -> Image:
        """What a camera sees now of the pattern that is held."""
        with self._lock:
            shot = self._next_shot(side)
            return self.source.view(side, self.shown, settings, brightness=self.brightness, shot=shot)

    def send_stray_pulse(self, side: Side, *, forced: bool = False) -> None:
        """A pulse on one camera's line that no projector sent; see ``EdgeReceiver`` for forced ones."""
        at_us = self.time.now_us()
        receiver = self._receivers[side]
        settings = receiver.edge_settings
        if settings is not None:
            receiver.on_edge(at_us, self.view(side, settings), forced=forced)

    def _next_shot(self, side: Side) -> int:
        shot = self._shots.get(side, 0)
        self._shots[side] = shot + 1
        return shot

    def send_pulse(self, index: int, at_us: float, faults: SequenceFaults) -> None:
        """Pulse ``index`` of the loaded sequence on both cameras' lines."""
        self.pulses_sent += 1
        for side, receiver in self._receivers.items():
            if faults.at("dead_camera", side, index):
                receiver.die()
            if faults.at("drifted", side, index):
                receiver.drift()
            if not faults.at("ignored", side, index):
                self._expose(side, receiver, index, at_us, faults)

    def _expose(self, side: Side, receiver: EdgeReceiver, index: int, at_us: float, faults: SequenceFaults) -> None:
        with self._lock:
            batch = self._batches.get(side)
            if batch is None or self.sequence is None or batch.plan != self.sequence.plan:
                return
            if not batch.used:
                batch.used = True
                self._next_shot(side)
        shown = batch.images[faults.order(side, len(batch.images))[index]]
        image = spoilt(shown, batch.settings.white_level, side, index, faults)
        delivery: Delivery = "whole"
        if faults.at("dropped", side, index):
            delivery = "dropped"
        elif faults.at("truncated", side, index):
            delivery = "truncated"
        late = faults.at("late", side, index)
        receiver.on_edge(at_us, image, delivery=delivery, delay_s=late.delay_s if late else 0.0)
        if faults.at("doubled", side, index):
            receiver.on_edge(at_us + _DOUBLED_AFTER_US, image, forced=True)
