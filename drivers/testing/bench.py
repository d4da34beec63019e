"""What a driver's author supplies: a closed device, and the hands that reach behind its driver."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from drivers.camera import (
    AppliedSettings,
    Camera,
    CameraLimits,
    CameraSettings,
    EdgeTriggered,
    SoftwareTriggered,
    Trigger,
    supported_triggers,
)
from drivers.projector import Projector

_SHORT_EXPOSURE_US = 2000.0


@dataclass(frozen=True, eq=False)
class CameraBench:
    """A closed camera on a workbench.

    pulse: make one electrical pulse reach the trigger input, whether the camera listens or not. unplug: make the
    device die; plug: bring it back. A hand that is None skips the tests that need it. patience_s: how long the
    device may take over anything that should happen at once.
    """

    camera: Camera
    pulse: Callable[[], None] | None = None
    unplug: Callable[[], None] | None = None
    plug: Callable[[], None] | None = None
    patience_s: float = 5.0

    def configured(self) -> AppliedSettings:
        """Open the camera and configure it to a short exposure."""
        return self.camera.configure(short_settings(self.camera.open().limits))

    def armed(self, trigger: Trigger, frames: int | None = None) -> AppliedSettings:
        """Open, configure and arm."""
        applied = self.configured()
        self.camera.arm(frames, trigger)
        return applied

    def has(self, trigger: Trigger) -> bool:
        """Whether the camera takes this trigger and the bench can give it."""
        wired = trigger is not Trigger.HARDWARE_EDGE or self.pulse is not None
        return wired and trigger in supported_triggers(self.camera)

    def quiet_trigger(self) -> Trigger:
        """A trigger under which no frame comes by itself; skips the test where the camera has none."""
        for trigger in (Trigger.HARDWARE_EDGE, Trigger.SOFTWARE):
            if trigger in supported_triggers(self.camera):
                return trigger
        pytest.skip("this camera only runs freely")

    def fire(self, trigger: Trigger, count: int = 1) -> None:
        """Start exposures by pulse or call, as far apart as the camera needs; nothing where it runs freely."""
        for _ in range(count):
            if trigger is Trigger.HARDWARE_EDGE:
                assert self.pulse is not None
                self.pulse()
            elif trigger is Trigger.SOFTWARE:
                assert isinstance(self.camera, SoftwareTriggered)
                self.camera.software_trigger()
            time.sleep(self.period_s())

    def period_s(self) -> float:
        """Time from one exposure to the next that loses none, at the settings in force."""
        applied = self.camera.read_settings()
        if isinstance(self.camera, EdgeTriggered):
            return 1e-6 * self.camera.min_period_us(as_asked(applied))
        return 2e-6 * applied.exposure_us

    def pull(self) -> None:
        """Unplug the device; skips the test where the bench cannot."""
        if self.unplug is None or self.plug is None:
            pytest.skip("this bench cannot unplug the camera")
        self.unplug()

    def replug(self) -> None:
        """Plug the device in again."""
        assert self.plug is not None
        self.plug()


@dataclass(frozen=True, eq=False)
class ProjectorBench:
    """A closed projector on a workbench.

    pulses: how many pulses came on its trigger line so far. unplug, plug, patience_s: as for CameraBench.
    """

    projector: Projector
    pulses: Callable[[], int]
    unplug: Callable[[], None] | None = None
    plug: Callable[[], None] | None = None
    patience_s: float = 5.0

    def pull(self) -> None:
        """Unplug the device; skips the test where the bench cannot."""
        if self.unplug is None or self.plug is None:
            pytest.skip("this bench cannot unplug the projector")
        self.unplug()

    def replug(self) -> None:
        """Plug the device in again."""
        assert self.plug is not None
        self.plug()


def short_settings(limits: CameraLimits) -> CameraSettings:
    """About 2 ms and 0 dB, as near as the camera comes."""
    low, high = limits.exposure_us
    quiet, loud = limits.gain_db
    return CameraSettings(
        exposure_us=min(max(_SHORT_EXPOSURE_US, low), high),
        gain_db=min(max(0.0, quiet), loud),
        bit_depth=limits.bit_depths[0],
    )


def as_asked(applied: AppliedSettings) -> CameraSettings:
    """Applied settings as a request for the same."""
    return CameraSettings.model_validate(
        {"exposure_us": applied.exposure_us, "gain_db": applied.gain_db, "bit_depth": applied.bit_depth}
    )
