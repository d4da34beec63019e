"""The rig's devices, opened: what they are, their wiring, their calibration, and one capture."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.devices import RigDevices
from drivers.registry import make_devices
from models.errors import DuofringeError
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest
from service.diagnosis.hardware import examine_hardware, is_wired
from service.diagnosis.symptom import Symptom
from service.diagnosis.wiring import examine_wiring
from service.settings import ServiceSettings


def examine_rig(settings: ServiceSettings, *, exposure: bool) -> Iterator[Symptom]:
    try:
        devices = make_devices(settings.rig)
    except DuofringeError as error:
        yield Symptom("rig", "fault", str(error), "attach the devices, or name another rig.driver in the configuration")
        return
    for warning in devices.warnings:
        yield Symptom("rig", "warning", warning)
    orchestrator = Orchestrator(devices, settings.acquisition)
    try:
        yield from _devices(orchestrator, exposure=exposure)
    finally:
        orchestrator.close()


def _devices(orchestrator: Orchestrator, *, exposure: bool) -> Iterator[Symptom]:
    try:
        orchestrator.connect()
    except RigNotConnectedError as error:
        for name, failure in error.failures.items():
            yield Symptom(name, "fault", failure, "mend what is named; else look at cable, power and permissions")
        return
    devices = orchestrator.devices
    for device in (devices.left, devices.right, devices.projector):
        info = device.info
        words = " ".join(word for word in (info.model, info.serial, info.firmware) if word)
        yield Symptom(device.name, "ok", f"{info.origin}, {words or info.driver} ({device.state})")
    yield from examine_hardware(devices)
    yield _calibration(devices)
    if exposure:
        yield from _in_the_light(orchestrator)


def _in_the_light(orchestrator: Orchestrator) -> Iterator[Symptom]:
    """A capture over a trigger line that is known to be broken would only say the same again."""
    wired = is_wired(orchestrator.devices) and orchestrator.acquisition.trigger == "projector"
    wires = list(examine_wiring(orchestrator)) if wired else []
    yield from wires
    if all(symptom.state != "fault" for symptom in wires):
        yield _test_exposure(orchestrator)


def _calibration(devices: RigDevices) -> Symptom:
    calibration = devices.calibration_in_force
    if calibration is None:
        return Symptom("calibration", "warning", "there is none", "set rig.calibration; captures can be taken without")
    for side, camera in devices.cameras.items():
        size = camera.info.size
        if size != calibration.cameras[side].size:
            sizes = f"{side} is for {calibration.cameras[side].size}, the camera delivers {size}"
            return Symptom("calibration", "fault", sizes, "calibrate at the size that the cameras deliver")
    low, high = calibration.working_depths
    projector = "with projector" if calibration.projector is not None else "without projector"
    return Symptom("calibration", "ok", f"{projector}, working range {low:.0f}..{high:.0f} mm")


def _test_exposure(orchestrator: Orchestrator) -> Symptom:
    """One composite exposure, or whatever the projector can show first, through all checks."""
    stored = orchestrator.devices.projector.info.stored
    has_composite = stored is None or "composite" in stored.kinds
    try:
        outcome = orchestrator.capture(CaptureRequest(plan="composite" if has_composite else "reference"))
    except SequenceRefusedError as error:
        return Symptom(
            "test exposure", "fault", str(error), "mend what is named; POST /v1/rig/assist finds an exposure"
        )
    except DuofringeError as error:
        return Symptom("test exposure", "fault", str(error), "mend what is named and run this again")
    warnings = [w for w in outcome.capture.record.warnings if w not in orchestrator.devices.warnings]
    text = f"{len(outcome.capture.plan)} exposure(s) proven in {outcome.acquisition_s:.2f} s"
    if warnings:
        return Symptom("test exposure", "warning", f"{text}; {warnings[0]}", "adjust exposure, gain or aim")
    return Symptom("test exposure", "ok", text)
