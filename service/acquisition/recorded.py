"""What one run of a plan leaves behind, however its exposures were started."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.camera import AppliedSettings, Camera, CameraSettings, Frame, StreamStatistics, Trigger
from drivers.errors import DriverError
from drivers.projector import LoadedSequence, ProjectorSettings
from models.geometry.rig import Side


@dataclass(frozen=True)
class RigSettings:
    """What the three devices are asked to hold during a sequence."""

    cameras: Mapping[Side, CameraSettings]
    projector: ProjectorSettings = field(default_factory=ProjectorSettings)

    def with_exposure(self, exposure_us: float | None) -> RigSettings:
        """The same with both cameras exposing for ``exposure_us``; unchanged for None."""
        if exposure_us is None:
            return self
        cameras = {side: s.model_copy(update={"exposure_us": exposure_us}) for side, s in self.cameras.items()}
        return RigSettings(cameras, self.projector)


@dataclass(frozen=True, eq=False)
class View:
    """What one camera delivered in a sequence.

    incomplete: position in order of arrival and the driver's word for it. error: what ended the collecting early.
    """

    device: str
    frames: tuple[Frame, ...]
    incomplete: Mapping[int, str]
    error: DriverError | None
    applied: AppliedSettings
    after: AppliedSettings | None
    statistics: StreamStatistics
    first_frame_id: int


@dataclass(frozen=True, eq=False)
class RecordedSequence:
    """Everything that one run of a plan left behind, good or bad.

    trigger: what started the exposures; by software the pulses are those calls, as they were made. started_ns:
    ``time.monotonic_ns`` just before the projector started. exposed_ns: when the last exposure was over, from where on
    the scene may move. timings_s: seconds per step. error: the projector's failure, if any.
    """

    loaded: LoadedSequence
    views: Mapping[Side, View]
    started_ns: int
    exposed_ns: int
    projector: ProjectorSettings
    error: DriverError | None = None
    timings_s: dict[str, float] = field(default_factory=dict)
    trigger: Trigger = Trigger.HARDWARE_EDGE


@dataclass
class Collected:
    """What came of one camera so far; see View."""

    frames: list[Frame] = field(default_factory=list)
    incomplete: dict[int, str] = field(default_factory=dict)
    error: DriverError | None = None


class Stopwatch:
    """Seconds per step, in order."""

    def __init__(self) -> None:
        self.timings_s: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.timings_s[step] = now - self._last
        self._last = now


def read_back(camera: Camera) -> AppliedSettings | None:
    """What a camera holds after a sequence, None where it does not answer."""
    try:
        return camera.read_settings()
    except DriverError:
        return None  # the collecting has met the same fault and says so


def views_of(
    cameras: Mapping[Side, Camera],
    collected: Mapping[Side, Collected],
    applied: Mapping[Side, AppliedSettings],
    after: Mapping[Side, AppliedSettings | None],
    statistics: Mapping[Side, StreamStatistics],
    first_ids: Mapping[Side, int],
) -> dict[Side, View]:
    """Each camera's part of a sequence, put together once the cameras are disarmed."""
    return {
        side: View(
            camera.name,
            tuple(collected[side].frames),
            collected[side].incomplete,
            collected[side].error,
            applied[side],
            after[side],
            statistics[side],
            first_ids[side],
        )
        for side, camera in cameras.items()
    }
