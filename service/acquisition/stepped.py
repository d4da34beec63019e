"""A plan without a trigger line: each pattern is held, and both cameras are told to take a frame of it.

Slow, and not for scenes that move; but nothing has to be wired. A pattern of several bits is light that flickers while
it is held: an exposure sees all of it where it lasts one whole pass, wherever it begins.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from drivers.camera import AppliedSettings, Camera, SoftwareTriggered, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DriverError, FrameTimeoutError, IncompleteFrameError
from drivers.projector import LoadedSequence
from drivers.sequence_rules import check_plan
from models.geometry.rig import Side
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

_SETTLE_S = 0.02
"""From the call that holds a pattern until its light is steady."""
_WHOLE = 0.001
"""Share of a pass that an exposure may lack or have too much."""
_FRAME_S = 1.0
"""Longest wait for a frame beyond its exposure."""


def record_stepped(
    devices: RigDevices, plan: PatternPlan, settings: RigSettings, cancellation: Cancellation
) -> RecordedSequence:
    """Hold each pattern of a plan in turn and take one frame of it with either camera.

    Raises DriverError when a device cannot be configured, armed or shown the pattern, and CaptureCancelledError.
    """
    cameras = devices.cameras
    triggers = {side: _software(camera) for side, camera in cameras.items()}
    collected = {side: Collected() for side in cameras}
    watch = Stopwatch()
    try:
        configured = configure(devices, plan, settings)
        applied, lit = configured.applied, configured.lit
        _require_whole_passes(devices, lit, applied)
        watch.lap("configure")
        for camera in cameras.values():
            camera.arm(len(plan), Trigger.SOFTWARE)
        watch.lap("arm")
        started_ns = time.monotonic_ns()
        calls_us: list[float] = []
        for pattern in lit.patterns:
            cancellation.raise_if_requested()
            devices.projector.show(pattern)
            cancellation.wait(_SETTLE_S)
            calls_us.append((time.monotonic_ns() - started_ns) / 1000)
            for side, trigger in triggers.items():
                _trigger(trigger, collected[side])
            for side, camera in cameras.items():
                _take(camera, collected[side], applied[side].exposure_us)
            if any(got.error is not None or len(got.frames) < len(calls_us) for got in collected.values()):
                break
        exposed_ns = time.monotonic_ns()
        watch.lap("expose")
        after = {side: read_back(camera) for side, camera in cameras.items()}
        firsts = {side: camera.info.first_frame_id for side, camera in cameras.items()}
    finally:
        devices.projector.stop()
        statistics = {side: camera.disarm() for side, camera in cameras.items()}
    watch.lap("disarm")
    views = views_of(cameras, collected, applied, after, statistics, firsts)
    return RecordedSequence(
        _as_shown(lit, calls_us),
        views,
        started_ns,
        exposed_ns,
        configured.projector,
        timings_s=watch.timings_s,
        trigger=Trigger.SOFTWARE,
    )


def _require_whole_passes(devices: RigDevices, lit: PatternPlan, applied: Mapping[Side, AppliedSettings]) -> None:
    """A pattern of several bits flickers: an exposure that sees a part of its passes sees other grey values."""
    pass_us = max(pattern.exposure_us or 0.0 for pattern in lit.patterns)
    check_plan(lit, pass_us, devices.projector.info)
    for side, camera in devices.cameras.items():
        passes = applied[side].exposure_us / pass_us
        if round(passes) < 1 or abs(passes - round(passes)) > _WHOLE * passes:
            raise DeviceConfigurationError(
                camera.name,
                "exposure_us",
                applied[side].exposure_us,
                f"without a trigger wire it must be {pass_us:g} us, the time of one pattern, or a multiple of it",
            )


def _software(camera: Camera) -> SoftwareTriggered:
    if not isinstance(camera, SoftwareTriggered):
        raise DeviceConfigurationError(camera.name, "trigger", Trigger.SOFTWARE, "no call can start this camera")
    return camera


def _trigger(camera: SoftwareTriggered, got: Collected) -> None:
    try:
        camera.software_trigger()
    except DriverError as error:
        got.error = error


def _take(camera: Camera, got: Collected, exposure_us: float) -> None:
    """The frame that was just asked for; nothing where none comes."""
    if got.error is not None:
        return
    try:
        got.frames.append(camera.wait_frame(1e-6 * exposure_us + _FRAME_S))
    except FrameTimeoutError:
        return
    except IncompleteFrameError as error:
        got.incomplete[len(got.frames)] = error.status
    except DriverError as error:
        got.error = error


def _as_shown(lit: PatternPlan, calls_us: list[float]) -> LoadedSequence:
    """The plan with the calls as its pulses; those that were not made any more count as made with the last."""
    calls_us = calls_us + [calls_us[-1]] * (len(lit) - len(calls_us))
    pulses_us = tuple(at_us - calls_us[0] for at_us in calls_us)
    return LoadedSequence(lit, pulses_us, pulses_us[-1] + (lit.patterns[-1].exposure_us or 0.0))
