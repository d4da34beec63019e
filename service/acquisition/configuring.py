"""Before any sequence: cameras and projector hold their settings, and the plan its exposures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.camera import AppliedSettings, Camera
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError
from drivers.projector import ProjectorSettings
from models.geometry.rig import Side
from models.patterns import PatternPlan
from service.acquisition.plans import with_exposure
from service.acquisition.recorded import RigSettings

_STEP = 0.001
"""Share of an exposure that a camera's steps may make it differ from what was asked."""


@dataclass(frozen=True)
class Configured:
    """What the devices hold, read back. lit: the plan, each pattern with the time that it is lit for."""

    applied: Mapping[Side, AppliedSettings]
    projector: ProjectorSettings
    lit: PatternPlan


def configure(devices: RigDevices, plan: PatternPlan, settings: RigSettings) -> Configured:
    """Have the projector dark and all devices configured; DriverError where one cannot be, or the cameras differ."""
    devices.projector.stop()
    applied = {side: camera.configure(settings.cameras[side]) for side, camera in devices.cameras.items()}
    _require_one_depth(devices.cameras, applied)
    projector = devices.projector.configure(settings.projector)
    return Configured(applied, projector, with_exposure(plan, lit_us(settings, applied)))


def lit_us(settings: RigSettings, applied: Mapping[Side, AppliedSettings]) -> float:
    """How long each pattern is to be lit, microseconds: as long as the shorter of both exposures.

    What a camera's steps take off or add is not passed on to the projector, whose shortest pattern has no room for it.
    """
    return min(_as_asked(settings.cameras[side].exposure_us, applied[side].exposure_us) for side in applied)


def _as_asked(asked_us: float, applied_us: float) -> float:
    return asked_us if abs(applied_us - asked_us) <= _STEP * asked_us else applied_us


def _require_one_depth(cameras: Mapping[Side, Camera], applied: Mapping[Side, AppliedSettings]) -> None:
    """A capture has one bit depth; DeviceConfigurationError where the cameras differ."""
    if len({a.bit_depth for a in applied.values()}) > 1:
        depths = {side: a.bit_depth for side, a in applied.items()}
        right = cameras["right"].name
        raise DeviceConfigurationError(right, "bit_depth", depths["right"], f"the left camera has {depths['left']}")
