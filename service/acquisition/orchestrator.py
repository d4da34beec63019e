"""The rig as a whole: connects its devices, takes captures one at a time, and leaves it safe whatever happens."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.camera import Camera, CameraSettings, CameraState
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DeviceNotFoundError, DriverError, SequenceInvalidError
from drivers.projector import Projector, ProjectorSettings, ProjectorState
from models.errors import DuofringeError
from models.geometry.rig import Side
from models.patterns import Pattern, PatternKind, PatternPlan
from service.acquisition.assist import Assistance, find_exposure
from service.acquisition.audit import AuditReport, audit
from service.acquisition.cancellation import Cancellation
from service.acquisition.checks import check_sequence
from service.acquisition.finding import Fault, Finding
from service.acquisition.live import LiveView
from service.acquisition.lock import RigBusyError, RigLock
from service.acquisition.outcome import CaptureOutcome, SequenceRefusedError
from service.acquisition.plans import PlanError, resolve_plan
from service.acquisition.record import make_capture
from service.acquisition.recorded import RecordedSequence, RigSettings
from service.acquisition.request import AssistRequest, CaptureRequest
from service.acquisition.sequence import record_sequence
from service.acquisition.settings import AcquisitionSettings
from service.acquisition.stepped import record_stepped

_SETTINGS_AT_FAULT = frozenset({Fault.SATURATED, Fault.MODULATION})
"""What another attempt under the same settings would show again."""
_LOOKING = "looking after the devices"


class RigNotConnectedError(DuofringeError):
    """A device is closed or lost. failures: by device, why it could not be opened, where that was tried."""

    def __init__(self, failures: dict[str, str]) -> None:
        listed = "; ".join(failures.values()) or "its devices are closed"
        super().__init__(f"the rig is not connected: {listed}; connect it again once this is mended")
        self.failures = failures


class SceneError(DuofringeError):
    """A scene was named that does not exist, or for a rig that stands before a real one."""


class Orchestrator:
    """Owns the devices of one rig; every public call may come from any thread."""

    def __init__(self, devices: RigDevices, acquisition: AcquisitionSettings | None = None) -> None:
        self.devices = devices
        self.acquisition = acquisition or AcquisitionSettings()
        self._lock = RigLock(self.acquisition.lock_wait_s)
        self._settings = RigSettings({side: CameraSettings() for side in devices.cameras})
        self._failures: dict[str, str] = {}
        self._cancellation: Cancellation | None = None
        self._closed = False
        self.live = LiveView(devices, lambda: self._settings, self._preview_pattern)

    @property
    def settings(self) -> RigSettings:
        """What captures use unless they say otherwise."""
        return self._settings

    @property
    def holder(self) -> str | None:
        """What the rig is busy with, or None."""
        return self._lock.holder

    @property
    def failures(self) -> dict[str, str]:
        """By device, why it could not be opened at the last try."""
        return dict(self._failures)

    @property
    def connected(self) -> bool:
        """Whether all three devices answer."""
        return not any(_is_down(device) for device in self._all())

    def connect(self) -> None:
        """Open whatever is not open, also after a fault. Raises RigNotConnectedError that tells of every failure."""
        with self._exclusively("connecting"):
            self._ask_all()
            self._open_all()

    def disconnect(self) -> None:
        """Close all devices."""
        with self._exclusively("disconnecting"):
            self._failures = {}
            self._close_all()

    def close(self) -> None:
        """Cancel what runs, end the live view, close all devices; for the end of the program."""
        self._closed = True
        self.cancel()
        self.live.close()
        self._close_all()
        self._failures = {}
        self.devices.release()

    def look_after(self) -> None:
        """Ask idle devices for a sign of life and open lost ones again; does nothing while the rig is in use.

        A device that is found lost, and why it cannot be opened, shows in its state and in ``failures``.
        """
        if self.live.running and not self._failures and not self._is_any_lost():
            return  # it asks the devices itself
        with (
            suppress(RigBusyError, RigNotConnectedError),
            self._lock.hold(_LOOKING, background=True),
            self.live.suspended(),
        ):
            self._ask_all()
            self._revive(give_way=True)

    def cancel(self) -> bool:
        """Ask the capture or assistant under way to stop; whether there was one."""
        cancellation = self._cancellation
        if cancellation is not None:
            cancellation.request()
            self.devices.projector.stop()  # also ends what the projector itself may be waiting for
        return cancellation is not None

    def configure_camera(self, side: Side, settings: CameraSettings) -> None:
        """Keep settings for one camera once the device took them. Raises DeviceConfigurationError, keeping the old."""
        with self._exclusively("changing settings"):
            self._require_connected()
            self.devices.cameras[side].configure(settings)
            cameras = {**self._settings.cameras, side: settings}
            self._settings = RigSettings(cameras, self._settings.projector)

    def configure_projector(self, settings: ProjectorSettings) -> None:
        """Likewise for the projector."""
        with self._exclusively("changing settings"):
            self._require_connected()
            self._settings = RigSettings(self._settings.cameras, self.devices.projector.configure(settings))

    def assist(self, request: AssistRequest) -> Assistance:
        """Search an exposure; kept where it was reached and ``apply`` is set."""
        with self._exclusively("finding the exposure"), self._cancellable() as cancellation:
            self._require_connected()
            found = find_exposure(self.devices, self._settings, request, cancellation)
            if found.reached and request.apply:
                self._settings = found.settings
            return found

    def capture(self, request: CaptureRequest, *, needs: frozenset[PatternKind] = frozenset()) -> CaptureOutcome:
        """Take one capture; complete and proven, or not at all.

        needs: patterns of which the capture must have one kind to be of use; a plan without is refused unprojected.
        Raises RigBusyError, RigNotConnectedError, PlanError, SceneError, SequenceInvalidError and
        DeviceConfigurationError where the request does not fit the rig, CaptureCancelledError, and
        SequenceRefusedError when no attempt could be kept.
        """
        begun = time.monotonic_ns()
        with self._exclusively("capture"), self._cancellable() as cancellation:
            self._revive()
            self._place(request.scene)
            plan = resolve_plan(request.plan, self.devices.projector.info.stored)
            if needs and not needs & plan.kinds:
                kinds = " or ".join(sorted(needs))
                raise PlanError(f"the plan lacks the {kinds} patterns that the reconstruction's method needs")
            settings = self._settings.with_exposure(request.exposure_us)
            refused: list[Finding] = []
            for attempt in range(1, self.acquisition.retakes + 2):
                cancellation.raise_if_requested()
                sequence, report, findings = self._attempt(plan, settings, cancellation)
                cancellation.raise_if_requested()
                if sequence is not None and report is not None and not findings:
                    capture = make_capture(self.devices, request, sequence, report, tuple(refused), attempt)
                    acquisition_s = (sequence.exposed_ns - begun) / 1e9
                    return CaptureOutcome(capture, sequence.timings_s, acquisition_s, attempt, tuple(refused))
                refused += findings
                if any(finding.fault in _SETTINGS_AT_FAULT for finding in findings) or not self._came_back():
                    break
            raise SequenceRefusedError(refused, attempt)

    def _attempt(
        self, plan: PatternPlan, settings: RigSettings, cancellation: Cancellation
    ) -> tuple[RecordedSequence | None, AuditReport | None, list[Finding]]:
        """One run of the plan with its checks; the findings are empty when it may be kept."""
        try:
            record = record_stepped if self.acquisition.trigger == "software" else record_sequence
            sequence = record(self.devices, plan, settings, cancellation)
        except (SequenceInvalidError, DeviceConfigurationError):
            raise
        except DriverError as error:
            return None, None, [Finding(Fault.LOST, error.device, str(error), error.index)]
        started = time.perf_counter()
        findings = [f for f in check_sequence(sequence, self.acquisition.late_s) if f.fatal]
        report = None
        if not findings:
            images = {
                side: {name: frame.image for name, frame in zip(plan.names, view.frames, strict=True)}
                for side, view in sequence.views.items()
            }
            white_level = sequence.views["left"].applied.white_level
            report = audit(images, plan, white_level, self.acquisition.audit)
            findings = [finding for finding in report.findings if finding.fatal]
        sequence.timings_s["audit"] = time.perf_counter() - started
        return sequence, report, findings

    def _place(self, scene: str | None) -> None:
        stage = self.devices.stage
        if stage is not None:
            try:
                stage.place(scene)
            except DeviceNotFoundError as error:
                raise SceneError(str(error)) from error
        elif scene is not None:
            raise SceneError(f"scene '{scene}': this rig stands before a real scene; leave 'scene' out")

    def _preview_pattern(self) -> Pattern | None:
        """What the live view lights the scene with: the configured pattern as this projector knows it."""
        name = self.acquisition.preview_pattern
        if name is None:
            return None
        stored = self.devices.projector.info.stored
        if stored is None:
            return resolve_plan((name,), None).patterns[0]
        return next((p for p in stored.patterns if p.name == name), stored.patterns[0])

    def _all(self) -> tuple[Camera | Projector, ...]:
        return (*self.devices.cameras.values(), self.devices.projector)

    def _ask_all(self) -> None:
        """Have every open device show that it is there; those that do not are lost."""
        for device in self._all():
            try:
                device.check()
            except DriverError as error:
                self._failures = {**self._failures, device.name: str(error)}

    def _is_any_lost(self) -> bool:
        return any(device.state in (CameraState.FAULT, ProjectorState.FAULT) for device in self._all())

    def _open_all(self, *, give_way: bool = False) -> None:
        """Open what is closed or lost; on a failure of one, the others stay open and the failures are told together.

        give_way: leave the rest for the next time once somebody waits for the rig.
        """
        if self._closed:
            raise RigNotConnectedError({})
        failures: dict[str, str] = {}
        for device in self._all():
            if give_way and self._lock.wanted:
                failures = {**self._failures, **failures}
                break
            if _is_down(device):
                device.close()
                try:
                    device.open()
                except DriverError as error:
                    failures[device.name] = str(error)
        self._failures = failures
        if failures:
            raise RigNotConnectedError(failures)

    def _close_all(self) -> None:
        self.devices.projector.close()
        for camera in self.devices.cameras.values():
            camera.close()

    def _revive(self, *, give_way: bool = False) -> None:
        """Open again what was lost; a rig that somebody disconnected stays so."""
        if self._is_any_lost() or self._failures:
            self._open_all(give_way=give_way)
        self._require_connected()

    def _came_back(self) -> bool:
        """Whether every device answers again after a failed attempt."""
        try:
            self._revive()
        except RigNotConnectedError:
            return False
        return True

    def _require_connected(self) -> None:
        if not self.connected:
            raise RigNotConnectedError(self._failures)

    @contextmanager
    def _exclusively(self, purpose: str) -> Iterator[None]:
        """The rig's lock, with the live view out of the way."""
        with self._lock.hold(purpose), self.live.suspended():
            yield

    @contextmanager
    def _cancellable(self) -> Iterator[Cancellation]:
        cancellation = Cancellation()
        self._cancellation = cancellation
        try:
            yield cancellation
        except DriverError:
            cancellation.raise_if_requested()  # a device that was stopped for it may say so as a failure
            raise
        finally:
            self._cancellation = None


def _is_down(device: Camera | Projector) -> bool:
    return device.state in (CameraState.CLOSED, CameraState.FAULT, ProjectorState.CLOSED, ProjectorState.FAULT)
