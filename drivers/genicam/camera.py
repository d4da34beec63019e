"""A GenICam camera behind the protocol of cameras, whatever library reaches it."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.camera import AppliedSettings, CameraInfo, CameraSettings, CameraState, Frame, StreamStatistics, Trigger
from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceStateError,
    DriverError,
    FrameTimeoutError,
    IncompleteFrameError,
)
from drivers.genicam import settings as setting
from drivers.genicam.configuration import GenicamConfiguration
from drivers.genicam.connection import Connection, FrameIds, FrameStream, LibraryError, Received
from drivers.genicam.features import lost

_MARGIN_US = 100.0
_SLICE_S = 0.02
"""How long ``wait_frame`` holds the lock at a time: ``close`` from another thread waits no longer."""
_SILENCE_S = 0.5
"""Without a frame for so long, the camera is asked whether it is still there."""


class GenicamCamera(ABC):
    """Implements Camera, EdgeTriggered and SoftwareTriggered over a Connection.

    name: role in the rig. ``disarm`` and ``close`` from another thread end a waiting ``wait_frame`` with
    DeviceStateError. Frame ids count from 0.
    """

    def __init__(self, name: str, configuration: GenicamConfiguration) -> None:
        self._name = name
        self._configuration = configuration
        self._lock = threading.RLock()
        self._leaving: set[object] = set()
        self._state = CameraState.CLOSED
        self._connection: Connection | None = None
        self._stream: FrameStream | None = None
        self._info: CameraInfo | None = None
        self._applied: AppliedSettings | None = None
        self._trigger = Trigger.FREE_RUN
        self._readout_us = configuration.readout_us
        self._statistics = StreamStatistics()
        self._armed_ns = 0

    @property
    @abstractmethod
    def _driver(self) -> str:
        """Name of the driver."""

    @abstractmethod
    def _connect(self) -> Connection:
        """Open the camera of the configuration; raises what ``open`` may."""

    @property
    def name(self) -> str:
        return self._name

    @property
    def state(self) -> CameraState:
        return self._state

    def open(self) -> CameraInfo:
        with self._lock:
            self._require("be opened", CameraState.CLOSED)
            connection = self._connect()
            try:
                info = self._learn(connection)
            except BaseException as error:  # whatever it is, the camera must not stay taken
                connection.release(dead=isinstance(error, DeviceLostError))
                raise
            self._connection, self._info = connection, info
            self._state = CameraState.OPEN
            return info

    @property
    def info(self) -> CameraInfo:
        info = self._info
        if info is None or self._state is CameraState.CLOSED:
            raise self._wrong_state("tell what it is")
        return info

    def configure(self, settings: CameraSettings) -> AppliedSettings:
        with self._lock:
            self._require("be configured", CameraState.OPEN, CameraState.CONFIGURED)
            setting.check_limits(self.info.limits, settings, self._name)
            with self._device() as connection:
                features = connection.features
                setting.prepare(features, self._configuration, self._name, settings.bit_depth)
                setting.set_exposure(features, settings)
                setting.set_trigger(features, self._configuration, Trigger.HARDWARE_EDGE)
                self._applied = setting.read_applied(features)
            self._state = CameraState.CONFIGURED
            return self._applied

    def read_settings(self) -> AppliedSettings:
        with self._lock:
            self._require("tell its settings", CameraState.CONFIGURED, CameraState.ARMED)
            with self._device() as connection:
                return setting.read_applied(connection.features)

    def check(self) -> None:
        """Ask the camera for a sign of life; does nothing while closed.

        Raises DeviceLostError, and the state is FAULT, where there is none.
        """
        with self._lock:
            if self._state is CameraState.CLOSED:
                return
            if self._state is CameraState.FAULT:
                raise lost(self._name)
            self._require_alive()

    def min_period_us(self, settings: CameraSettings) -> float:
        """Overlapping, a pulse is lost during exposure, or before the last readout has ended; else during both."""
        exposure_us, readout_us = settings.exposure_us, self._readout_us
        if self._configuration.trigger_overlap == "Off":
            return exposure_us + readout_us + _MARGIN_US
        return max(exposure_us, readout_us) + _MARGIN_US

    def arm(self, frames: int | None, trigger: Trigger) -> None:
        with self._lock:
            self._require("be armed", CameraState.CONFIGURED)
            with self._device() as connection:
                features = connection.features
                if not self._configuration.processing:
                    setting.require_straight(features, self._name)
                setting.set_trigger(features, self._configuration, trigger)
                ids = FrameIds(gige=connection.gige, first=self._configuration.first_frame_id)
                self._stream = connection.make_stream(frames, ids)
                self._armed_ns = time.monotonic_ns()
                self._stream.start()
                if trigger is not Trigger.FREE_RUN:
                    self._await_readiness(connection)
            self._trigger = trigger
            self._state = CameraState.ARMED

    def wait_frame(self, timeout_s: float) -> Frame:
        deadline = time.monotonic() + timeout_s
        ask_at = time.monotonic() + _SILENCE_S
        stream = self._stream
        while True:
            with self._lock:
                if self._stream is not stream:
                    raise self._ended_meanwhile()
                self._require("give a frame", CameraState.ARMED)
                assert stream is not None
                left_s = max(0.0, deadline - time.monotonic())
                received = self._pop(stream, round(1e6 * min(left_s, _SLICE_S)))
                if received is not None:
                    return self._frame(stream, received)
                now = time.monotonic()
                if now >= min(deadline, ask_at) or self._device_gone():
                    self._require_alive()
                    ask_at = now + _SILENCE_S
                if now >= deadline:
                    raise FrameTimeoutError(self._name, f"no frame within {timeout_s:g} s")
            if self._leaving:
                raise self._ended_meanwhile()

    def software_trigger(self) -> None:
        """Waits until the camera would take it."""
        with self._lock:
            self._require("be triggered", CameraState.ARMED)
            if self._trigger is not Trigger.SOFTWARE:
                raise DeviceStateError(self._name, "cannot be triggered by a call; it is armed for something else")
            with self._device() as connection:
                self._await_readiness(connection)
                connection.features.execute("TriggerSoftware")

    def disarm(self) -> StreamStatistics:
        with self._leave():
            self._end_stream()
            if self._state is CameraState.ARMED:
                self._state = CameraState.CONFIGURED
            return self._statistics

    def close(self) -> None:
        with self._leave():
            self._end_stream()
            connection = self._connection
            if connection is not None:
                dead = self._state is CameraState.FAULT or not connection.is_alive()
                connection.release(dead=dead)
            self._connection = self._info = self._applied = None
            self._state = CameraState.CLOSED

    def _learn(self, connection: Connection) -> CameraInfo:
        features = connection.features
        setting.prepare(features, self._configuration, self._name)
        setting.set_trigger(features, self._configuration, Trigger.HARDWARE_EDGE)
        if features.has("SensorReadoutTime"):
            self._readout_us = features.read("SensorReadoutTime", float)
        return CameraInfo(
            driver=self._driver,
            model=" ".join((features.first_text("DeviceVendorName"), features.first_text("DeviceModelName"))).strip(),
            serial=features.serial,
            firmware=features.first_text("DeviceFirmwareVersion", "DeviceVersion"),
            origin="simulated" if connection.simulated else "real",
            size=(features.read("Width", int), features.read("Height", int)),
            limits=setting.read_limits(features),
        )

    def _await_readiness(self, connection: Connection) -> None:
        exposure_us = self._applied.exposure_us if self._applied else 0.0
        setting.await_readiness(connection.features, exposure_us, self._configuration)

    def _pop(self, stream: FrameStream, timeout_us: int) -> Received | None:
        """A stream that breaks off does not mend by itself."""
        try:
            return stream.pop(timeout_us)
        except LibraryError as error:
            self._require_alive()
            self._state = CameraState.FAULT
            raise DeviceLostError(
                self._name, f"its stream of frames broke off ({error}); close and open it again"
            ) from error

    def _frame(self, stream: FrameStream, received: Received) -> Frame:
        assert self._applied is not None
        if received.image is None:
            raise IncompleteFrameError(self._name, received.problem, index=received.frame_id)
        if received.image.shape != self._applied.size[::-1]:
            height, width = received.image.shape
            raise IncompleteFrameError(self._name, f"it measures {width}x{height}", index=received.frame_id)
        now_ns = time.monotonic_ns()
        host_ns = min(max(now_ns - (time.time_ns() - received.system_ns), self._armed_ns), now_ns)
        self._armed_ns = host_ns  # the wall clock may be set; arrivals still follow one another
        stream.delivered += 1
        return Frame(
            image=received.image,
            frame_id=received.frame_id,
            device_ns=received.device_ns,
            host_ns=host_ns,
            exposure_us=self._applied.exposure_us,
            gain_db=self._applied.gain_db,
        )

    def _end_stream(self) -> None:
        stream, connection = self._stream, self._connection
        if stream is None or connection is None:
            return
        if self._state is not CameraState.FAULT and not connection.is_alive():
            self._state = CameraState.FAULT
        left = stream.end(dead=self._state is CameraState.FAULT)
        self._statistics = StreamStatistics(delivered=stream.delivered, unclaimed=left, lost=stream.lost)
        self._stream = None

    @contextmanager
    def _leave(self) -> Iterator[None]:
        leaver = object()
        self._leaving.add(leaver)
        try:
            with self._lock:
                yield
        finally:
            self._leaving.discard(leaver)

    @contextmanager
    def _device(self) -> Iterator[Connection]:
        """The device, found alive; whatever fails inside leaves no stream, and FAULT where the device has died."""
        self._require_alive()
        connection = self._connection
        assert connection is not None
        armed = self._state is CameraState.ARMED
        try:
            yield connection
        except (LibraryError, DriverError) as error:
            if isinstance(error, DeviceLostError) or not connection.is_alive():
                self._state = CameraState.FAULT
                raise lost(self._name) from error
            if not armed:
                self._end_stream()
            if isinstance(error, LibraryError):
                raise DeviceConfigurationError(
                    self._name, "acquisition", "started", f"the camera says: {error}"
                ) from error
            raise

    @contextmanager
    def asked(self) -> Iterator[Connection]:
        """The connection of an open camera, for questions beyond the protocol; nobody else has the camera meanwhile.

        Raises DeviceStateError while it is closed, DeviceLostError where it is gone.
        """
        with self._lock:
            if self._connection is None:
                raise self._wrong_state("be asked")
            with self._device() as connection:
                yield connection

    def _device_gone(self) -> bool:
        return self._connection is not None and self._connection.control_lost

    def _require_alive(self) -> None:
        if self._connection is None or not self._connection.is_alive():
            self._state = CameraState.FAULT
            raise lost(self._name)

    def _require(self, purpose: str, *states: CameraState) -> None:
        if self._state is CameraState.FAULT:
            raise lost(self._name)
        if self._state not in states:
            raise self._wrong_state(purpose)

    def _wrong_state(self, purpose: str) -> DriverError:
        return DeviceStateError(self._name, f"cannot {purpose} while it is {self._state}")

    def _ended_meanwhile(self) -> DriverError:
        return DeviceStateError(self._name, "was disarmed or closed while a frame was awaited")
