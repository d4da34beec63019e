"""One sequence: arm both cameras, start the projector, collect, leave everything safe.

The order is what keeps pattern k and frame k together: the projector is loaded and dark, both cameras are armed and see
the trigger line, and only then does the projector start. Whatever happens, it ends dark and the cameras disarmed.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

from drivers.camera import AppliedSettings, Camera, CameraSettings, EdgeTriggered, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DriverError, FrameTimeoutError, IncompleteFrameError
from drivers.projector import LoadedSequence, Projector, ProjectorState
from models.patterns import PatternPlan
from service.acquisition.cancellation import Cancellation
from service.acquisition.configuring import configure
from service.acquisition.recorded import (
    Collected,
    RecordedSequence,
    RigSettings,
    Stopwatch,
    read_back,
    views_of,
)

_SLICE_S = 0.05
"""Longest wait before a collector looks at the cancellation."""
_SETTLE_S = 0.002
_HELD_UP_S = 0.5
"""A frame may be held up by this and is then told as late, rather than as lost."""
_START_S = 1.0
"""Time that a projector may take from the call to its first pulse."""


def record_sequence(
    devices: RigDevices, plan: PatternPlan, settings: RigSettings, cancellation: Cancellation
) -> RecordedSequence:
    """Show a plan once and collect what the cameras see of it; judging it is ``check_sequence``'s.

    Raises DriverError when a device cannot be configured, loaded, armed or started, and CaptureCancelledError.
    """
    cameras = devices.cameras
    watch = Stopwatch()
    with ThreadPoolExecutor(len(cameras), thread_name_prefix="duofringe-collector") as pool:
        try:
            configured = configure(devices, plan, settings)
            applied = configured.applied
            watch.lap("configure")
            cancellation.raise_if_requested()
            period_us = max(_shortest_period_us(camera, applied[side]) for side, camera in cameras.items())
            loaded = devices.projector.load(configured.lit, period_us)
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
            after = {side: read_back(camera) for side, camera in cameras.items()}
            firsts = {side: camera.info.first_frame_id for side, camera in cameras.items()}
        finally:
            devices.projector.stop()
            statistics = {side: camera.disarm() for side, camera in cameras.items()}
    watch.lap("disarm")
    views = views_of(cameras, collected, applied, after, statistics, firsts)
    return RecordedSequence(loaded, views, started_ns, exposed_ns, configured.projector, error, watch.timings_s)


def _shortest_period_us(camera: Camera, applied: AppliedSettings) -> float:
    if not isinstance(camera, EdgeTriggered):
        raise DeviceConfigurationError(camera.name, "trigger", Trigger.HARDWARE_EDGE, "this camera has no trigger line")
    return camera.min_period_us(CameraSettings(exposure_us=applied.exposure_us, gain_db=applied.gain_db))


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


def _collect(camera: Camera, patience: _Patience, cancellation: Cancellation) -> Collected:
    """Take frames in order of arrival until all are there, one is overdue, or the camera fails."""
    got = Collected()
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
