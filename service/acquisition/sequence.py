"""One sequence: arm both cameras, start the projector, collect, leave everything safe.

The order is what keeps pattern k and frame k together: the projector is loaded and dark, both cameras are armed and see
the trigger line, and only then does the projector start. Whatever happens, it ends dark and the cameras disarmed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from drivers.camera import AppliedSettings, Camera, CameraSettings, EdgeTriggered, Frame, StreamStatistics, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DriverError, FrameTimeoutError, IncompleteFrameError
from drivers.projector import LoadedSequence, Projector, ProjectorSettings, ProjectorState
from models.geometry.rig import Side
from models.patterns import PatternPlan
from service.acquisition.cancellation import Cancellation
from service.acquisition.plans import with_exposure

_SLICE_S = 0.05
"""Longest wait before a collector looks at the cancellation."""
_SETTLE_S = 0.002
_HELD_UP_S = 0.5
"""A frame may be held up by this and is then told as late, rather than as lost."""
_START_S = 1.0
"""Time that a projector may take from the call to its first pulse."""


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

    started_ns: ``time.monotonic_ns`` just before the projector started. exposed_ns: when the last exposure was over,
    from where on the scene may move. timings_s: seconds per step. error: the projector's failure, if any.
    """

    loaded: LoadedSequence
    period_us: float
    views: Mapping[Side, View]
    started_ns: int
    exposed_ns: int
    projector: ProjectorSettings
    error: DriverError | None = None
    timings_s: dict[str, float] = field(default_factory=dict)


@dataclass
class _Collected:
    frames: list[Frame] = field(default_factory=list)
    incomplete: dict[int, str] = field(default_factory=dict)
    error: DriverError | None = None


class _Stopwatch:
    """Seconds per step, in order."""

    def __init__(self) -> None:
        self.timings_s: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.timings_s[step] = now - self._last
        self._last = now


def record_sequence(
    devices: RigDevices, plan: PatternPlan, settings: RigSettings, cancellation: Cancellation
) -> RecordedSequence:
    """Show a plan once and collect what the cameras see of it; judging it is ``check_sequence``'s.

    Raises DriverError when a device cannot be configured, loaded, armed or started, and CaptureCancelledError.
    """
    cameras = devices.cameras
    watch = _Stopwatch()
    with ThreadPoolExecutor(len(cameras), thread_name_prefix="duofringe-collector") as pool:
        try:
            devices.projector.stop()
            applied = {side: camera.configure(settings.cameras[side]) for side, camera in cameras.items()}
            _require_one_depth(cameras, applied)
            projector_settings = devices.projector.configure(settings.projector)
            watch.lap("configure")
            cancellation.raise_if_requested()
            period_us = max(_shortest_period_us(camera, settings.cameras[side]) for side, camera in cameras.items())
            lit = with_exposure(plan, min(a.exposure_us for a in applied.values()))
            loaded = devices.projector.load(lit, period_us)
            watch.lap("load")
            cancellation.raise_if_requested()
            for camera in cameras.values():
                camera.arm(len(plan), Trigger.HARDWARE_EDGE)
            watch.lap("arm")
            cancellation.raise_if_requested()
            time.sleep(_SETTLE_S)  # a pulse that comes now is not ours, and its frame shows it by its time
            started_ns = time.monotonic_ns()
            devices.projector.start()
            collecting = {
                side: pool.submit(_collect, camera, _Patience(loaded, applied[side], started_ns), cancellation)
                for side, camera in cameras.items()
            }
            collected = {side: future.result() for side, future in collecting.items()}
            error = _wait_until_dark(devices.projector, started_ns, loaded, cancellation)
            exposed_ns = time.monotonic_ns()
            cancellation.raise_if_requested()
            # an extra frame of a bounced edge is still being read out
            cancellation.wait(max(a.exposure_us for a in applied.values()) / 1e6 + _SETTLE_S)
            watch.lap("expose")
            after = {side: _read_back(camera) for side, camera in cameras.items()}
            firsts = {side: camera.info.first_frame_id for side, camera in cameras.items()}
        finally:
            devices.projector.stop()
            statistics = {side: camera.disarm() for side, camera in cameras.items()}
    watch.lap("disarm")
    views = {
        side: View(
            camera.name,
            tuple(collected[side].frames),
            collected[side].incomplete,
            collected[side].error,
            applied[side],
            after[side],
            statistics[side],
            firsts[side],
        )
        for side, camera in cameras.items()
    }
    return RecordedSequence(
        loaded, period_us, views, started_ns, exposed_ns, projector_settings, error, watch.timings_s
    )


def _shortest_period_us(camera: Camera, settings: CameraSettings) -> float:
    if not isinstance(camera, EdgeTriggered):
        raise DeviceConfigurationError(camera.name, "trigger", Trigger.HARDWARE_EDGE, "this camera has no trigger line")
    return camera.min_period_us(settings)


def _require_one_depth(cameras: Mapping[Side, Camera], applied: Mapping[Side, AppliedSettings]) -> None:
    """A capture has one bit depth."""
    if len({a.bit_depth for a in applied.values()}) > 1:
        depths = {side: a.bit_depth for side, a in applied.items()}
        right = cameras["right"].name
        raise DeviceConfigurationError(right, "bit_depth", depths["right"], f"the left camera has {depths['left']}")


class _Patience:
    """Until when each frame is waited for: long for the first, as a projector may be slow to start."""

    def __init__(self, loaded: LoadedSequence, applied: AppliedSettings, started_ns: int) -> None:
        period_us = loaded.duration_us / max(1, len(loaded.pulses_us))
        self._pulses_us = loaded.pulses_us
        self._room_us = max(3 * period_us, applied.exposure_us) + 1e6 * _HELD_UP_S
        self._origin_ns = started_ns + round(1e9 * _START_S)

    def __len__(self) -> int:
        return len(self._pulses_us)

    def first_came(self, host_ns: int) -> None:
        """The first frame arrived then; the others follow it as their pulses do."""
        self._origin_ns = host_ns

    def remaining_s(self, position: int) -> float:
        """Time left for the frame at this position in order of arrival."""
        until_ns = self._origin_ns + 1000 * (self._pulses_us[position] + self._room_us)
        return (until_ns - time.monotonic_ns()) / 1e9


def _collect(camera: Camera, patience: _Patience, cancellation: Cancellation) -> _Collected:
    """Take frames in order of arrival until all are there, one is overdue, or the camera fails."""
    got = _Collected()
    while len(got.frames) + len(got.incomplete) < len(patience) and not cancellation.requested:
        position = len(got.frames) + len(got.incomplete)
        remaining_s = patience.remaining_s(position)
        if remaining_s <= 0:
            break
        try:
            got.frames.append(camera.wait_frame(min(_SLICE_S, remaining_s)))
        except FrameTimeoutError:
            continue
        except IncompleteFrameError as error:
            got.incomplete[position] = error.status
        except DriverError as error:
            got.error = error
            break
        if position == 0:
            patience.first_came(time.monotonic_ns())
    return got


def _wait_until_dark(
    projector: Projector, started_ns: int, loaded: LoadedSequence, cancellation: Cancellation
) -> DriverError | None:
    """Wait for the end of the projection; returns what is wrong with the projector."""
    until = started_ns + round(1000 * loaded.duration_us) + round(1e9 * _START_S)
    while projector.state is ProjectorState.PROJECTING:
        if time.monotonic_ns() > until:
            return DriverError(projector.name, "the sequence did not end in its time; it was stopped")
        cancellation.wait(_SETTLE_S)
    if projector.state is ProjectorState.FAULT:
        return DriverError(projector.name, "was lost during the sequence; check its cables and connect again")
    return None


def _read_back(camera: Camera) -> AppliedSettings | None:
    try:
        return camera.read_settings()
    except DriverError:
        return None  # the collecting has met the same fault and says so
