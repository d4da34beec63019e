"""A scene source whose images tell which pattern they show."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from drivers.camera import AppliedSettings, BitDepth, CameraInfo, CameraLimits, CameraSettings, Frame, Trigger
from drivers.devices import RigDevices
from drivers.errors import DriverError, FrameTimeoutError, IncompleteFrameError
from drivers.projector import ProjectorInfo
from drivers.virtual.source import PixelFormat
from models.capture import Image, Truth
from models.geometry.rig import Rig, Side
from models.patterns import Pattern, PatternPlan, make_plan

PLAN = make_plan("reference").restricted_to(["white", "high_00", "high_01", "high_02", "gray_00", "black"])
PERIOD_US = 10_000.0
HELD = 7
WHITE_LEVEL = 255


@dataclass
class Asked:
    side: Side
    pattern: str
    exposure_us: float
    lit_us: float
    brightness: float
    shot: int
    thread: str


@dataclass
class PaintedSource:
    """Every image of pattern k is 20 (k + 1), plus one in its first column; the live view is ``HELD``, dark 1."""

    asked: list[Asked] = field(default_factory=list)
    scene: str = "only"
    stored: PatternPlan | None = None

    @property
    def scenes(self) -> Sequence[str]:
        return (self.scene,)

    def place(self, name: str | None = None) -> str:
        self.scene = name or self.scene
        return self.scene

    @property
    def calibration(self) -> Rig | None:
        return None

    @property
    def truth(self) -> Truth | None:
        return None

    @property
    def provenance(self) -> dict[str, Any]:
        return {}

    @property
    def object_id(self) -> str | None:
        return None

    def camera_info(self, side: Side) -> CameraInfo:
        limits = CameraLimits((20.0, 350_000.0), (0.0, 24.0), (8,))
        return CameraInfo("painted", "", f"{side}-1", "", "simulated", (16, 12), limits, first_frame_id=1)

    @property
    def projector_info(self) -> ProjectorInfo:
        return ProjectorInfo("painted", "", "", "", "simulated", None, stored=self.stored)

    def pixel_format(self, side: Side, bit_depth: BitDepth) -> PixelFormat:
        return PixelFormat((16, 12), bit_depth, WHITE_LEVEL)

    def prepare(self, plan: PatternPlan) -> None:
        pass

    def image(
        self, side: Side, pattern: Pattern, settings: AppliedSettings, *, lit_us: float, brightness: float, shot: int
    ) -> Image:
        thread = threading.current_thread().name
        self.asked.append(Asked(side, pattern.name, settings.exposure_us, lit_us, brightness, shot, thread))
        return self._paint(20 * (PLAN.names.index(pattern.name) + 1))

    def view(
        self, side: Side, pattern: Pattern | None, settings: AppliedSettings, *, brightness: float, shot: int
    ) -> Image:
        return self._paint(1 if pattern is None else HELD)

    def _paint(self, level: int) -> Image:
        image = np.full((12, 16), level, np.uint8)
        image[:, 0] += 1
        return image


def shown(frame: Frame) -> str | int:
    """The pattern that a frame shows, or its grey level where that is none."""
    level = int(frame.image[0, 8])
    return PLAN.names[level // 20 - 1] if level % 20 == 0 and 0 < level // 20 <= len(PLAN) else level


def opened(devices: RigDevices, settings: CameraSettings | None = None) -> RigDevices:
    """Open all three, configure the cameras."""
    devices.projector.open()
    for camera in devices.cameras.values():
        camera.open()
        camera.configure(settings or CameraSettings())
    return devices


def close(devices: RigDevices) -> None:
    devices.projector.close()
    for camera in devices.cameras.values():
        camera.close()


def arm(devices: RigDevices, plan: PatternPlan = PLAN) -> None:
    for camera in devices.cameras.values():
        camera.arm(len(plan), Trigger.HARDWARE_EDGE)


def load_and_arm(devices: RigDevices, plan: PatternPlan = PLAN, period_us: float = PERIOD_US) -> None:
    devices.projector.load(plan, period_us)
    arm(devices, plan)


def collect(devices: RigDevices, timeout_s: float = 0.0) -> dict[Side, list[Frame | DriverError]]:
    """Frames and errors of both cameras until nothing more comes."""
    return {side: _of_one(devices, side, timeout_s) for side in devices.cameras}


def _of_one(devices: RigDevices, side: Side, timeout_s: float) -> list[Frame | DriverError]:
    got: list[Frame | DriverError] = []
    while True:
        try:
            got.append(devices.cameras[side].wait_frame(timeout_s))
        except FrameTimeoutError:
            return got
        except IncompleteFrameError as error:
            got.append(error)
        except DriverError as error:
            return [*got, error]


def run(devices: RigDevices, plan: PatternPlan = PLAN) -> dict[Side, list[Frame | DriverError]]:
    """One sequence of devices that take no time."""
    load_and_arm(devices, plan)
    devices.projector.start()
    return collect(devices)


def frames_of(got: list[Frame | DriverError]) -> list[Frame]:
    """All of them are frames."""
    assert all(isinstance(item, Frame) for item in got), got
    return [item for item in got if isinstance(item, Frame)]


def names_of(got: list[Frame | DriverError]) -> list[str | int]:
    return [shown(frame) for frame in frames_of(got)]


def ids_of(got: list[Frame | DriverError]) -> list[int]:
    return [frame.frame_id for frame in frames_of(got)]


def gaps_of(got: list[Frame | DriverError]) -> list[float]:
    """Microseconds between frames on the camera's clock."""
    times = [frame.device_ns for frame in frames_of(got)]
    return [(b - a) / 1000 for a, b in pairwise(times)]
