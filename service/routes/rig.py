"""The rig: what it is made of, its settings, the exposure assistant."""

from __future__ import annotations

import hashlib
from typing import Any, Literal

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field

from drivers.camera import Camera, CameraSettings, CameraState, supported_triggers
from drivers.errors import DriverError
from drivers.projector import Projector, ProjectorSettings, ProjectorState
from models.geometry.rig import Side
from service.acquisition.assist import Assistance
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.request import AssistRequest
from service.context import ServiceDep
from service.idempotency import IdempotencyKey, answer_once
from service.routes.documented import problems

router = APIRouter(prefix="/v1/rig", tags=["rig"])


class DeviceView(BaseModel):
    """A device as it is now; what only an open device tells is null while it is closed."""

    role: Literal["left", "right", "projector"]
    state: CameraState | ProjectorState
    driver: str | None = None
    model: str | None = None
    serial: str | None = None
    firmware: str | None = None
    origin: Literal["real", "simulated", "replayed"] | None = Field(
        None, description="Hardware, a simulation, or the replay of recorded captures."
    )
    settings: dict[str, Any] = Field({}, description="exposure_us, gain_db, bit_depth; brightness of a projector.")
    limits: dict[str, Any] = {}
    triggers: list[str] = Field([], description="What can start an exposure of this camera.")
    patterns: list[str] | None = Field(None, description="Patterns that this projector stores; null: it shows any.")


class CalibrationView(BaseModel):
    """The calibration that the next capture will carry."""

    fingerprint: str = Field(description="SHA-256; reconstructions name theirs the same way.")
    has_projector: bool
    working_range_mm: tuple[float, float]
    quality: dict[str, Any]


class RigView(BaseModel):
    """The rig. busy: what holds it, or null."""

    connected: bool
    busy: str | None = None
    replayed: bool = Field(description="Images are recorded ones: whatever stands before the rig is not seen.")
    simulated: bool
    devices: list[DeviceView]
    calibration: CalibrationView | None = None
    scene: str | None = Field(None, description="The simulated scene or recorded capture before the rig.")
    scenes: list[str] = Field(
        [], description="Values that a capture's 'scene' can take; of an endless series the first."
    )
    warnings: list[str] = []
    failures: dict[str, str] = Field({}, description="By device, why it could not be opened.")


class CameraPatch(BaseModel):
    """What is left out stays."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"exposure_us": 16667, "gain_db": 3}]})

    exposure_us: float | None = Field(None, gt=0, allow_inf_nan=False, strict=True)
    gain_db: float | None = Field(None, allow_inf_nan=False, strict=True)
    bit_depth: Literal[8, 12] | None = None


class ProjectorPatch(BaseModel):
    """brightness: share of the largest LED current allowed."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"brightness": 0.8}]})

    brightness: float = Field(ge=0, le=1, allow_inf_nan=False, strict=True)


class ReadingView(BaseModel):
    """One camera under white light; shares of full scale and of the image."""

    brightest: float = Field(description="99th percentile of the lit pixels, share of full scale.")
    lit: float
    saturated: float


class AssistView(BaseModel):
    """What the exposure assistant found."""

    reached: bool
    applied: bool
    reason: str = Field("", description="Why the target was not reached.")
    cameras: dict[Side, CameraSettings]
    projector: ProjectorSettings
    readings: dict[Side, ReadingView]


class CancelView(BaseModel):
    """cancelled: something was under way and has been asked to stop."""

    cancelled: bool


@router.get("", operation_id="getRig", summary="Devices, settings, calibration in force")
def get_rig(service: ServiceDep) -> RigView:
    return rig_view(service.orchestrator)


@router.post(
    "/connect", operation_id="connectRig", summary="Open all devices, also after a fault", responses=problems(409, 503)
)
def connect(service: ServiceDep) -> RigView:
    service.orchestrator.connect()
    return rig_view(service.orchestrator)


@router.post("/disconnect", operation_id="disconnectRig", summary="Close all devices", responses=problems(409))
def disconnect(service: ServiceDep) -> RigView:
    service.orchestrator.disconnect()
    return rig_view(service.orchestrator)


@router.post("/cancel", operation_id="cancelCapture", summary="Stop the capture or assistant under way")
def cancel(service: ServiceDep) -> CancelView:
    return CancelView(cancelled=service.orchestrator.cancel())


@router.patch(
    "/cameras/{side}",
    operation_id="changeCamera",
    summary="Change a camera's settings",
    responses=problems(409, 422, 503),
)
def change_camera(side: Side, patch: CameraPatch, service: ServiceDep) -> DeviceView:
    orchestrator = service.orchestrator
    changes = patch.model_dump(exclude_none=True)
    orchestrator.configure_camera(side, orchestrator.settings.cameras[side].model_copy(update=changes))
    return _camera_view(side, orchestrator.devices.cameras[side], orchestrator)


@router.patch(
    "/projector", operation_id="changeProjector", summary="Change the brightness", responses=problems(409, 422, 503)
)
def change_projector(patch: ProjectorPatch, service: ServiceDep) -> DeviceView:
    orchestrator = service.orchestrator
    orchestrator.configure_projector(ProjectorSettings(brightness=patch.brightness))
    return _projector_view(orchestrator.devices.projector, orchestrator)


@router.post(
    "/assist",
    operation_id="assistExposure",
    summary="Find the exposure that fills the range without saturating",
    responses=problems(409, 422, 503),
)
def assist(
    service: ServiceDep,
    response: Response,
    request: AssistRequest | None = None,
    idempotency_key: IdempotencyKey = None,
) -> AssistView:
    request = request or AssistRequest.model_validate({})
    body, repeated = answer_once(
        service.library,
        idempotency_key,
        "assist",
        request,
        lambda _: _assist_view(service.orchestrator.assist(request), request),
    )
    if repeated:
        response.headers["Idempotency-Replayed"] = "true"
    return AssistView.model_validate(body)


def _assist_view(found: Assistance, request: AssistRequest) -> AssistView:
    return AssistView(
        reached=found.reached,
        applied=found.reached and request.apply,
        reason=found.reason,
        cameras=dict(found.settings.cameras),
        projector=found.settings.projector,
        readings={
            side: ReadingView(brightest=r.brightest, lit=r.lit, saturated=r.saturated)
            for side, r in found.readings.items()
        },
    )


def rig_view(orchestrator: Orchestrator) -> RigView:
    """The rig as it is now; does not wait for whoever holds it."""
    devices = [
        *(_camera_view(side, camera, orchestrator) for side, camera in orchestrator.devices.cameras.items()),
        _projector_view(orchestrator.devices.projector, orchestrator),
    ]
    stage = orchestrator.devices.stage
    return RigView(
        connected=orchestrator.connected,
        busy=orchestrator.holder,
        replayed=any(device.origin == "replayed" for device in devices),
        simulated=any(device.origin == "simulated" for device in devices),
        devices=devices,
        calibration=_calibration_view(orchestrator),
        scene=None if stage is None else stage.scene,
        scenes=[] if stage is None else list(stage.scenes),
        warnings=list(orchestrator.devices.warnings),
        failures=orchestrator.failures,
    )


def _calibration_view(orchestrator: Orchestrator) -> CalibrationView | None:
    rig = orchestrator.devices.calibration_in_force
    if rig is None:
        return None
    return CalibrationView(
        fingerprint=hashlib.sha256(rig.fingerprint.encode()).hexdigest(),
        has_projector=rig.projector is not None,
        working_range_mm=rig.working_depths,
        quality=dict(rig.quality),
    )


def _camera_view(side: Side, camera: Camera, orchestrator: Orchestrator) -> DeviceView:
    settings = orchestrator.settings.cameras[side].model_dump()
    triggers = sorted(str(trigger) for trigger in supported_triggers(camera))
    try:
        info = camera.info
    except DriverError:
        return DeviceView(role=side, state=camera.state, settings=settings, triggers=triggers)
    return DeviceView(
        role=side,
        state=camera.state,
        driver=info.driver,
        model=info.model,
        serial=info.serial,
        firmware=info.firmware,
        origin=info.origin,
        settings={**settings, "size": info.size},
        limits={
            "exposure_us": info.limits.exposure_us,
            "gain_db": info.limits.gain_db,
            "bit_depths": info.limits.bit_depths,
        },
        triggers=triggers,
    )


def _projector_view(projector: Projector, orchestrator: Orchestrator) -> DeviceView:
    settings = orchestrator.settings.projector.model_dump()
    try:
        info = projector.info
    except DriverError:
        return DeviceView(role="projector", state=projector.state, settings=settings)
    raster = info.raster
    return DeviceView(
        role="projector",
        state=projector.state,
        driver=info.driver,
        model=info.model,
        serial=info.serial,
        firmware=info.firmware,
        origin=info.origin,
        settings=settings,
        limits={
            "brightness": (0.0, 1.0),
            "exposure_us": info.limits.exposure_us,
            "binary_exposure_us": info.limits.binary_exposure_us,
            "patterns": info.limits.patterns,
            "raster": None if raster is None else {"size": (raster.columns, raster.rows), "kind": raster.kind},
        },
        patterns=None if info.stored is None else list(info.stored.names),
    )
