"""A camera whose images come from a scene source."""

from __future__ import annotations

import math
import threading
import time

from drivers.camera import (
    AppliedSettings,
    CameraInfo,
    CameraSettings,
    CameraState,
    Frame,
    StreamStatistics,
    Trigger,
)
from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStateError,
    DriverError,
    FrameTimeoutError,
    IncompleteFrameError,
)
from drivers.virtual.bench import Bench, Delivery
from drivers.virtual.clock import DeviceClock
from drivers.virtual.stream import Stream
from models.capture import Image
from models.geometry.rig import Side

READOUT_US = 2500.0
"""480 rows of a Grasshopper3, about."""
_EXPOSURE_MARGIN_US = 100.0
_FREE_RUN_PERIOD_US = 1e6 / 30
_DRIFT = 0.9
_CLOCKS: dict[Side, DeviceClock] = {
    "left": DeviceClock(81_234_567_890_123, 11.0),
    "right": DeviceClock(4_567_890_321, -9.0),
}
"""Switched on on different days, and 20 ppm apart."""
FEATURES: dict[str, str | float | bool] = {
    "gamma": "off",
    "exposure_auto": "off",
    "gain_auto": "off",
    "sharpening": "off",
    "lookup_table": "off",
    "trigger_overlap": "read_out",
}


class VirtualCamera:
    """Implements Camera, EdgeTriggered and SoftwareTriggered.

    ``disarm`` and ``close`` from another thread end a waiting ``wait_frame`` with DeviceStateError. A pulse is ignored
    that comes while the camera is not armed for pulses, or sooner after the last than ``min_period_us``.
    """

    def __init__(self, side: Side, bench: Bench) -> None:
        self._side: Side = side
        self._bench = bench
        self._clock = _CLOCKS[side]
        self._changed = threading.Condition()
        self._state = CameraState.CLOSED
        self._held: CameraSettings | None = None
        self._lost = False
        self._plugged = True
        self._trigger: Trigger | None = None
        self._stream: Stream | None = None
        self._statistics = StreamStatistics()
        self._last_start_us = -math.inf
        bench.attach(side, self)

    @property
    def name(self) -> str:
        return f"{self._side} camera"

    @property
    def state(self) -> CameraState:
        return self._state

    def open(self) -> CameraInfo:
        with self._changed:
            if self._state is not CameraState.CLOSED:
                raise self._wrong_state("be opened")
            if not self._plugged or (self._lost and self._bench.faults.spend("dead_camera", self._side)):
                raise DeviceNotFoundError(self.name, "does not answer; check its cable and power")
            info = self._bench.source.camera_info(self._side)
            self._lost = False
            self._state = CameraState.OPEN
            return info

    @property
    def info(self) -> CameraInfo:
        if self._state is CameraState.CLOSED:
            raise self._wrong_state("tell what it is")
        return self._bench.source.camera_info(self._side)

    def configure(self, settings: CameraSettings) -> AppliedSettings:
        with self._changed:
            self._require("be configured", CameraState.OPEN, CameraState.CONFIGURED)
            limits = self._bench.source.camera_info(self._side).limits
            for feature, unit, wanted, (low, high) in (
                ("exposure_us", "us", settings.exposure_us, limits.exposure_us),
                ("gain_db", "dB", settings.gain_db, limits.gain_db),
            ):
                if not low <= wanted <= high:
                    raise DeviceConfigurationError(self.name, feature, wanted, f"it takes {low:g} to {high:g} {unit}")
            if settings.bit_depth not in limits.bit_depths:
                known = " or ".join(map(str, limits.bit_depths))
                raise DeviceConfigurationError(self.name, "bit_depth", settings.bit_depth, f"it delivers {known} bits")
            self._held = settings.model_copy(
                update={
                    "exposure_us": float(round(settings.exposure_us)),
                    "gain_db": round(settings.gain_db, 1),
                }
            )
            self._state = CameraState.CONFIGURED
            return self._applied(self._held)

    def read_settings(self) -> AppliedSettings:
        with self._changed:
            self._require("tell its settings", CameraState.CONFIGURED, CameraState.ARMED)
            assert self._held is not None
            return self._applied(self._held)

    def check(self) -> None:
        with self._changed:
            if self._state is CameraState.FAULT:
                raise self._lost_error()

    def _applied(self, held: CameraSettings) -> AppliedSettings:
        pixels = self._bench.source.pixel_format(self._side, held.bit_depth)
        return AppliedSettings(
            exposure_us=held.exposure_us,
            gain_db=held.gain_db,
            bit_depth=pixels.bit_depth,
            white_level=pixels.white_level,
            size=pixels.size,
            features=dict(FEATURES),
        )

    def min_period_us(self, settings: CameraSettings) -> float:
        """Readout overlaps the next exposure, so a pulse is lost only during exposure, or before readout has ended."""
        return max(settings.exposure_us + _EXPOSURE_MARGIN_US, READOUT_US)

    def arm(self, frames: int | None, trigger: Trigger) -> None:
        with self._changed:
            self._require("be armed", CameraState.CONFIGURED)
            self._stream = Stream()
            self._last_start_us = -math.inf
            self._trigger = trigger
            self._state = CameraState.ARMED
        if trigger is Trigger.HARDWARE_EDGE:
            self._bench.get_ready()
            if self._bench.faults.strike("early", self._side):
                self._bench.send_stray_pulse(self._side, forced=True)

    def wait_frame(self, timeout_s: float) -> Frame:
        deadline = time.monotonic() + timeout_s
        with self._changed:
            stream = self._stream
            if stream is None:
                self._require("give a frame", CameraState.ARMED)
            assert stream is not None
            if self._state is CameraState.ARMED and self._trigger is Trigger.FREE_RUN:
                return self._run_freely(stream, deadline, timeout_s)
            while True:
                self._require_still(stream)
                due_s = stream.due_s
                if due_s is not None and due_s <= time.monotonic():
                    return stream.claim()
                if due_s is None and self._state is CameraState.FAULT:
                    raise self._lost_error()
                self._sleep_until(deadline if due_s is None else due_s, deadline, timeout_s)

    def _sleep_until(self, wake_s: float, deadline: float, timeout_s: float) -> None:
        now = time.monotonic()
        if now >= deadline:
            raise FrameTimeoutError(self.name, f"no frame within {timeout_s:g} s")
        self._changed.wait(max(0.0, min(wake_s, deadline) - now))

    def _require_still(self, stream: Stream) -> None:
        if self._stream is not stream:
            raise DeviceStateError(self.name, "was disarmed or closed while a frame was awaited")

    def _run_freely(self, stream: Stream, deadline: float, timeout_s: float) -> Frame:
        """Called with the lock held; lets go of it while the image is made."""
        assert self._held is not None
        held, bench = self._held, self._bench
        period_us = max(_FREE_RUN_PERIOD_US, self.min_period_us(held))
        start_us = max(bench.time.now_us(), self._last_start_us + period_us)
        end_s = bench.time.comes_s(start_us + held.exposure_us)
        while time.monotonic() < end_s:
            self._sleep_until(end_s, deadline, timeout_s)
            self._require_still(stream)
            if self._state is CameraState.FAULT:
                raise self._lost_error()
        self._last_start_us = start_us
        bench.time.reach(start_us + held.exposure_us)
        settings = self._applied(held)
        self._changed.release()
        try:
            image = bench.view(self._side, settings)
        finally:
            self._changed.acquire()
        self._require_still(stream)
        now = time.monotonic()
        stream.put(self._frame(stream, start_us, image, held, now), now)
        return stream.claim()

    def software_trigger(self) -> None:
        with self._changed:
            self._require("be triggered", CameraState.ARMED)
            if self._trigger is not Trigger.SOFTWARE:
                raise DeviceStateError(self.name, "cannot be triggered by a call; it is armed for something else")
            assert self._held is not None
            stream, held = self._stream, self._held
            start_us = max(self._bench.time.now_us(), self._last_start_us + self.min_period_us(held))
            self._last_start_us = start_us
        self._bench.time.reach(start_us)
        image = self._bench.view(self._side, self._applied(held))
        with self._changed:
            if stream is not None and self._stream is stream and self._state is CameraState.ARMED:
                self._take(stream, start_us, image, held, "whole", 0.0)

    def disarm(self) -> StreamStatistics:
        with self._changed:
            self._end_stream()
            if self._state is CameraState.ARMED:
                self._state = CameraState.CONFIGURED
            return self._statistics

    def close(self) -> None:
        with self._changed:
            self._end_stream()
            self._state = CameraState.CLOSED
            self._held = None

    def _end_stream(self) -> None:
        if self._stream is not None:
            self._statistics = self._stream.statistics()
            self._stream = None
            self._changed.notify_all()

    @property
    def edge_settings(self) -> AppliedSettings | None:
        """See ``EdgeReceiver``."""
        with self._changed:
            if self._state is not CameraState.ARMED or self._trigger is not Trigger.HARDWARE_EDGE:
                return None
            return None if self._held is None else self._applied(self._held)

    def on_edge(
        self, at_us: float, image: Image, *, delivery: Delivery = "whole", delay_s: float = 0.0, forced: bool = False
    ) -> None:
        """See ``EdgeReceiver``."""
        with self._changed:
            if self._state is not CameraState.ARMED or self._trigger is not Trigger.HARDWARE_EDGE:
                return
            assert self._held is not None
            assert self._stream is not None
            if not forced:
                if at_us - self._last_start_us < self.min_period_us(self._held) - 1e-3:
                    return
                self._last_start_us = at_us
            self._take(self._stream, at_us, image, self._held, delivery, delay_s)

    def die(self) -> None:
        """See ``EdgeReceiver``: what was under way still arrives."""
        with self._changed:
            if self._state is not CameraState.CLOSED:
                self._state = CameraState.FAULT
                self._lost = True
                self._changed.notify_all()

    def unplug(self) -> None:
        """Be gone until ``plug``."""
        self._plugged = False
        self.die()

    def plug(self) -> None:
        """Be there again; a camera that was open must be closed and opened."""
        self._plugged = True

    def drift(self) -> None:
        """See ``EdgeReceiver``."""
        with self._changed:
            if self._held is not None:
                self._held = self._held.model_copy(
                    update={"exposure_us": float(round(self._held.exposure_us * _DRIFT))}
                )

    def _take(
        self, stream: Stream, at_us: float, image: Image, held: CameraSettings, delivery: Delivery, delay_s: float
    ) -> None:
        """Expose, read out, and send behind what was sent before; the lock is held."""
        readout_ends_s = self._bench.time.comes_s(at_us + held.exposure_us + READOUT_US)
        due_s = stream.behind(max(readout_ends_s, time.monotonic()) + delay_s)
        frame = self._frame(stream, at_us, image, held, due_s)
        if delivery == "dropped":
            stream.lose()
        elif delivery == "truncated":
            stream.put(IncompleteFrameError(self.name, "half of its lines came", index=stream.exposures - 1), due_s)
        else:
            stream.put(frame, due_s)
        self._changed.notify_all()

    def _frame(self, stream: Stream, at_us: float, image: Image, held: CameraSettings, due_s: float) -> Frame:
        frame_id = self._bench.source.camera_info(self._side).first_frame_id + stream.exposures
        stream.exposures += 1
        return Frame(
            image=image.copy(),
            frame_id=frame_id,
            device_ns=self._clock.ns(at_us),
            host_ns=round(due_s * 1e9),
            exposure_us=held.exposure_us,
            gain_db=held.gain_db,
        )

    def _require(self, purpose: str, *states: CameraState) -> None:
        if self._state is CameraState.FAULT:
            raise self._lost_error()
        if self._state not in states:
            raise self._wrong_state(purpose)

    def _wrong_state(self, purpose: str) -> DriverError:
        return DeviceStateError(self.name, f"cannot {purpose} while it is {self._state}")

    def _lost_error(self) -> DriverError:
        return DeviceLostError(self.name, "does not answer any more; close and open it again")
