"""An examination of the computer, the library, the rig's devices and their calibration."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from drivers.devices import RigDevices
from drivers.registry import make_devices
from models.errors import DuofringeError
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest
from service.settings import ServiceSettings

_LITTLE_MEMORY_BYTES = 2 << 30


@dataclass(frozen=True)
class Symptom:
    """One thing looked at. remedy: what to do about it, empty when it is well."""

    subject: str
    state: Literal["ok", "warning", "fault"]
    finding: str
    remedy: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def examine(settings: ServiceSettings) -> tuple[Symptom, ...]:
    """Everything, in the order in which one would mend it; opens and closes the rig's devices."""
    return (*_computer(), *_library(settings), *_rig(settings))


def _computer() -> Iterator[Symptom]:
    yield Symptom("python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    text = f"{cores} cores, {memory / 1e9:.1f} GB of memory"
    if memory < _LITTLE_MEMORY_BYTES:
        yield Symptom("computer", "warning", text, "a single-shot reconstruction needs about 1 GB; add memory")
    else:
        yield Symptom("computer", "ok", text)


def _library(settings: ServiceSettings) -> Iterator[Symptom]:
    folder = settings.library.folder
    existing = next((path for path in (folder, *folder.absolute().parents) if path.exists()), folder)
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        yield Symptom("library", "fault", f"'{existing}' cannot be written to", "set library.folder or its permissions")
        return
    free = shutil.disk_usage(existing).free
    text = f"{folder}, {free / 1e9:.1f} GB free"
    if free < settings.library.minimum_free_bytes:
        limit = f"{settings.library.minimum_free_bytes / 1e9:.1f} GB must stay free"
        yield Symptom("library", "fault", text, f"{limit}; delete captures or set library.folder to a larger disk")
    else:
        yield Symptom("library", "ok", text)


def _rig(settings: ServiceSettings) -> Iterator[Symptom]:
    try:
        devices = make_devices(settings.rig)
    except DuofringeError as error:
        yield Symptom("rig", "fault", str(error), "attach the devices, or name another rig.driver in the configuration")
        return
    for warning in devices.warnings:
        yield Symptom("rig", "warning", warning)
    orchestrator = Orchestrator(devices, settings.acquisition)
    try:
        yield from _devices(orchestrator)
    finally:
        orchestrator.close()


def _devices(orchestrator: Orchestrator) -> Iterator[Symptom]:
    try:
        orchestrator.connect()
    except RigNotConnectedError as error:
        for name, failure in error.failures.items():
            yield Symptom(name, "fault", failure, "check cable, power and permissions, then run this again")
        return
    devices = orchestrator.devices
    for device in (devices.left, devices.right, devices.projector):
        info = device.info
        words = " ".join(word for word in (info.model, info.serial, info.firmware) if word)
        yield Symptom(device.name, "ok", f"{info.origin}, {words or info.driver} ({device.state})")
    yield _calibration(devices)
    yield _test_exposure(orchestrator)


def _calibration(devices: RigDevices) -> Symptom:
    rig = devices.calibration_in_force
    if rig is None:
        return Symptom("calibration", "warning", "there is none", "set rig.calibration; captures can be taken without")
    for side, camera in devices.cameras.items():
        size = camera.info.size
        if size != rig.cameras[side].size:
            sizes = f"{side} is for {rig.cameras[side].size}, the camera delivers {size}"
            return Symptom("calibration", "fault", sizes, "calibrate at the size that the cameras deliver")
    low, high = rig.working_depths
    projector = "with projector" if rig.projector is not None else "without projector"
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
