"""From a good sequence to a capture: images by pattern, and where they come from."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from drivers.camera import AppliedSettings, CameraInfo
from drivers.devices import RigDevices
from drivers.projector import ProjectorInfo
from models.capture import Capture, CaptureRecord, DeviceRecord, Image, Truth
from models.geometry.rig import Side
from service.acquisition.audit import AuditReport
from service.acquisition.finding import Finding
from service.acquisition.recorded import RecordedSequence
from service.acquisition.request import CaptureRequest


def make_capture(
    devices: RigDevices,
    request: CaptureRequest,
    sequence: RecordedSequence,
    report: AuditReport,
    refused: tuple[Finding, ...],
    attempts: int,
) -> Capture:
    """The capture of a sequence that passed every check. refused: findings of earlier attempts."""
    plan = sequence.loaded.plan
    images: dict[Side, dict[str, Image]] = {
        side: {name: frame.image for name, frame in zip(plan.names, view.frames, strict=True)}
        for side, view in sequence.views.items()
    }
    applied = sequence.views["left"].applied
    retaken = tuple(f"retaken: {finding.message}" for finding in refused)
    stage = devices.stage
    extra: dict[str, Any] = {"attempts": attempts}
    if request.notes is not None:
        extra["notes"] = request.notes
    if stage is not None:
        extra["scene"] = {"name": stage.scene, **stage.provenance}
    record = CaptureRecord.model_validate(
        {
            "created": datetime.now(UTC),
            "devices": device_records(devices),
            "settings": _settings(sequence, report),
            "frame_ids": {side: [frame.frame_id for frame in view.frames] for side, view in sequence.views.items()},
            "timestamps_ns": {
                side: [frame.device_ns for frame in view.frames] for side, view in sequence.views.items()
            },
            "warnings": (*devices.warnings, *report.warnings, *retaken),
            "object_id": request.object_id or (None if stage is None else stage.object_id),
            "bit_depth": applied.bit_depth,
            "white_level": applied.white_level,
            **extra,
        }
    )
    truth = None if stage is None else _fitting(stage.truth, applied)
    return Capture(plan, images, devices.calibration_in_force, record, truth, source="capture")


def device_records(devices: RigDevices) -> tuple[DeviceRecord, ...]:
    """The three devices as captures name them."""
    infos: dict[str, CameraInfo | ProjectorInfo] = {
        **{side: camera.info for side, camera in devices.cameras.items()},
        "projector": devices.projector.info,
    }
    return tuple(
        DeviceRecord.model_validate(
            {
                "role": role,
                "driver": info.driver,
                "model": info.model,
                "serial": info.serial,
                "firmware": info.firmware,
                "origin": info.origin,
            }
        )
        for role, info in infos.items()
    )


def _settings(sequence: RecordedSequence, report: AuditReport) -> dict[str, Any]:
    cameras = {side: asdict(view.applied) for side, view in sequence.views.items()}
    left = sequence.views["left"].applied
    return {
        "exposure_us": left.exposure_us,
        "gain_db": left.gain_db,
        "cameras": cameras,
        "trigger": str(sequence.trigger),
        "projector": {**sequence.projector.model_dump(), "pulses_us": list(sequence.loaded.pulses_us)},
        "audit": {"statistics": report.statistics, "proven": report.proven},
    }


def _fitting(truth: Truth | None, applied: AppliedSettings) -> Truth | None:
    """Truth belongs to the images only where it has their size."""
    if truth is None or truth.depth.shape != (applied.size[1], applied.size[0]):
        return None
    return truth
