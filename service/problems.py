"""Errors as RFC 9457 problem details, mapped from exceptions in this one place."""

from __future__ import annotations

import json
import logging
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, replace
from http import HTTPStatus
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.encoders import jsonable_encoder
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.routing import Match

from drivers.errors import DeviceConfigurationError, DriverError, SequenceInvalidError
from models.errors import CalibrationError, CaptureError, DatasetError, DuofringeError, ReconstructionError
from models.refiner.errors import RefinerError
from service.acquisition.cancellation import CaptureCancelledError
from service.acquisition.lock import RigBusyError
from service.acquisition.orchestrator import RigNotConnectedError, SceneError
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.plans import PlanError
from service.compute import ComputeBusyError
from service.idempotency import KeyInProgressError, KeyMismatchError
from service.jobs.errors import JobsFullError, JobStateError, WeightsTakenError
from service.library.errors import (
    ArchiveError,
    CursorError,
    DamagedError,
    DiskFullError,
    InvalidIdError,
    LibraryError,
    LimitError,
    NotFoundError,
)
from service.reconstructions import CaptureKeptError

MEDIA_TYPE = "application/problem+json"
logger = logging.getLogger("duofringe.service")
_METHODS = ("GET", "POST", "PATCH", "DELETE")
_PATH_CHARACTERS = "/:@!$&'()*+,;=~"


class FieldError(BaseModel):
    """One thing wrong with a request. field: where, as a dotted path beginning with body, query, path or header."""

    field: str
    message: str


class Problem(BaseModel):
    """Problem details (RFC 9457). ``type`` is stable, and answers a GET with its meaning."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(examples=["/v1/problems/rig-busy"])
    title: str = Field(examples=["The rig is busy"])
    status: int = Field(examples=[409])
    detail: str = Field(examples=["the rig is busy (capture); try again in 1 s"])
    instance: str = Field("", examples=["/v1/captures"])
    errors: list[FieldError] | None = None


@dataclass(frozen=True)
class ProblemType:
    """A kind of problem: stable name, HTTP status, title, and what a client does about it."""

    slug: str
    status: int
    title: str
    remedy: str

    @property
    def uri(self) -> str:
        return f"/v1/problems/{self.slug}"


_BY_EXCEPTION: Mapping[type[DuofringeError], ProblemType] = {
    RigBusyError: ProblemType("rig-busy", 409, "The rig is busy", "Ask again after Retry-After seconds."),
    ComputeBusyError: ProblemType(
        "compute-busy", 503, "Too many reconstructions wait", "Ask again after Retry-After seconds."
    ),
    RigNotConnectedError: ProblemType(
        "rig-not-connected", 503, "The rig is not connected", "Mend what 'failures' names, then POST /v1/rig/connect."
    ),
    SequenceRefusedError: ProblemType(
        "capture-refused",
        502,
        "No attempt gave images that may be kept",
        "'findings' names device, exposure and pattern of every fault; nothing was stored.",
    ),
    CaptureCancelledError: ProblemType(
        "capture-cancelled", 409, "The capture was cancelled", "Nothing was stored; capture again when ready."
    ),
    PlanError: ProblemType("plan-invalid", 422, "The plan cannot be shown", "Choose another plan or other patterns."),
    SequenceInvalidError: ProblemType(
        "sequence-invalid", 422, "The projector cannot show this sequence", "Change exposure or patterns as told."
    ),
    DeviceConfigurationError: ProblemType(
        "setting-invalid", 422, "A device does not take this setting", "Stay within the limits that /v1/rig reports."
    ),
    SceneError: ProblemType(
        "scene-unknown", 422, "There is no such scene", "Name one of the scenes of /v1/rig, or leave it out."
    ),
    DriverError: ProblemType(
        "device-fault", 503, "A device failed", "Check the device named, then POST /v1/rig/connect."
    ),
    InvalidIdError: ProblemType(
        "not-found", 404, "There is no such thing", "List what exists and take an id from there."
    ),
    NotFoundError: ProblemType(
        "not-found", 404, "There is no such thing", "List what exists and take an id from there."
    ),
    DamagedError: ProblemType(
        "damaged", 422, "What is stored is damaged", "Restore the files named from a backup, or delete it."
    ),
    CursorError: ProblemType("cursor-invalid", 422, "The cursor is not one of ours", "Begin without a cursor."),
    ArchiveError: ProblemType("archive-invalid", 422, "The archive is not a capture", "Mend the archive as told."),
    LimitError: ProblemType("too-large", 413, "Over a limit", "Send less; the limits are in the configuration."),
    DiskFullError: ProblemType("disk-full", 507, "The library's disk is full", "Free space; nothing was written."),
    KeyMismatchError: ProblemType(
        "idempotency-key-reused", 422, "The Idempotency-Key belongs to another request", "Use a new key a request."
    ),
    KeyInProgressError: ProblemType(
        "idempotency-key-in-progress",
        409,
        "The first request with this key is under way",
        "Ask again with the same key.",
    ),
    LibraryError: ProblemType("library-fault", 503, "The library does not answer", "See the service's log."),
    CalibrationError: ProblemType(
        "calibration-unusable", 422, "The calibration does not serve", "Name a calibration in the configuration."
    ),
    CaptureError: ProblemType("capture-unusable", 422, "The capture does not serve", "Capture with the plan it needs."),
    CaptureKeptError: ProblemType(
        "captured-not-reconstructed",
        422,
        "The capture was stored but gave no cloud",
        "Look at the capture that 'capture' names; reconstruct it with other options.",
    ),
    DatasetError: ProblemType(
        "dataset-unusable",
        422,
        "The dataset does not serve",
        "Name a folder of the service's datasets folder, and a split that it has.",
    ),
    JobsFullError: ProblemType("jobs-full", 429, "Too many jobs wait", "Ask again after Retry-After seconds."),
    JobStateError: ProblemType(
        "job-state", 409, "The job's state does not allow it", "Look at the job's 'state' and 'links'."
    ),
    WeightsTakenError: ProblemType(
        "weights-exist", 409, "The weights' name is taken", "Give the new weights another name."
    ),
    RefinerError: ProblemType(
        "weights-unusable",
        422,
        "The refiner's weights do not serve",
        "Name weights that are for the capture's fringes, or another method.",
    ),
    ReconstructionError: ProblemType(
        "reconstruction-failed", 422, "The images gave no trustworthy cloud", "Do what 'detail' suggests."
    ),
    DuofringeError: ProblemType("request-failed", 422, "The request could not be fulfilled", "Do what 'detail' says."),
}
VALIDATION = ProblemType("validation", 422, "The request is not valid", "Mend the fields that 'errors' names.")
INTERNAL = ProblemType(
    "internal", 500, "An error of the service itself", "Report it with what the service's log says under 'reference'."
)
_BY_STATUS: Mapping[int, ProblemType] = {
    kind.status: kind
    for kind in (
        ProblemType("bad-request", 400, "The request is malformed", "Address the service by a name that it serves."),
        ProblemType("unauthorized", 401, "A key is needed", "Send 'Authorization: Bearer KEY'."),
        ProblemType(
            "cross-origin", 403, "The request comes from another site", "Use the page of this service, or a key."
        ),
        _BY_EXCEPTION[NotFoundError],
        ProblemType("method-not-allowed", 405, "The method does not fit", "Use a method that 'Allow' names."),
        _BY_EXCEPTION[LimitError],
        ProblemType("media-type", 415, "The body has another type", "Send JSON as application/json, archives as zip."),
    )
}

PROBLEM_TYPES: Mapping[str, ProblemType] = {
    kind.slug: kind for kind in (*_BY_EXCEPTION.values(), VALIDATION, INTERNAL, *_BY_STATUS.values())
}


class ProblemResponse(JSONResponse):
    """What cannot be written in UTF-8, as half a surrogate pair of a request, becomes a question mark."""

    media_type = MEDIA_TYPE

    def render(self, content: Any) -> bytes:
        return json.dumps(content, ensure_ascii=False, allow_nan=False).encode("utf-8", "replace")


def problem_response(
    kind: ProblemType, detail: str, instance: str, *, headers: Mapping[str, str] | None = None, **members: Any
) -> JSONResponse:
    """A problem as a response. instance: path of the request, not quoted. members: extension members."""
    body = {
        "type": kind.uri,
        "title": kind.title,
        "status": kind.status,
        "detail": detail,
        "instance": quote(instance, _PATH_CHARACTERS, errors="replace"),
        "remedy": kind.remedy,
        **jsonable_encoder(members),
    }
    return ProblemResponse(body, kind.status, headers)


def problem_of(error: DuofringeError) -> ProblemType:
    """The kind of the nearest class that is listed."""
    kind = next(_BY_EXCEPTION[cls] for cls in type(error).__mro__ if cls in _BY_EXCEPTION)
    if isinstance(error, CaptureKeptError):
        return replace(kind, status=problem_of(error.cause).status)
    return kind


def members_of(error: DuofringeError) -> dict[str, Any]:
    """What the exception knows besides its text."""
    members: dict[str, Any] = {}
    if isinstance(error, CaptureKeptError):
        members["capture"] = f"/v1/captures/{error.capture}"
    if isinstance(error, SequenceRefusedError):
        members |= {"findings": [finding.as_json() for finding in error.findings], "attempts": error.attempts}
    if isinstance(error, RigNotConnectedError):
        members["failures"] = error.failures
    if isinstance(error, DriverError):
        members |= {"device": error.device, "index": error.index}
    if isinstance(error, DeviceConfigurationError):
        members["errors"] = [{"field": error.feature, "message": str(error)}]
    return members


def install(app: FastAPI) -> None:
    """Register the handlers."""

    @app.exception_handler(DuofringeError)
    async def expected(request: Request, error: DuofringeError) -> JSONResponse:
        cause = error.cause if isinstance(error, CaptureKeptError) else error
        retry_after = getattr(cause, "retry_after_s", None)
        headers = None if retry_after is None else {"Retry-After": str(retry_after)}
        kind = problem_of(error)
        if kind.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            logger.warning("%s %s: %s", request.method, request.url.path, error)
        return problem_response(kind, str(error), request.url.path, headers=headers, **members_of(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return _invalid(request, [_field_error(e) for e in error.errors()])

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> JSONResponse:
        if error.status_code == HTTPStatus.BAD_REQUEST and isinstance(error.__cause__, (ValueError, RecursionError)):
            return _invalid(request, [{"field": "body", "message": "cannot be read as JSON"}])
        headers = dict(error.headers or {})
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = ", ".join(_methods(request))
        return http_problem(error.status_code, str(error.detail), request.url.path, headers)

    @app.exception_handler(Exception)
    async def unexpected(request: Request, error: Exception) -> JSONResponse:
        reference = uuid.uuid4().hex[:12]
        logger.error("%s %s failed, reference %s", request.method, request.url.path, reference, exc_info=error)
        detail = f"the service met an error of its own; its log has the details under {reference}"
        return problem_response(INTERNAL, detail, request.url.path, reference=reference)


def http_problem(status: int, detail: str, instance: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """A plain HTTP error, such as 404 of a path that does not exist, as a problem."""
    kind = _BY_STATUS.get(status)
    if kind is not None:
        return problem_response(kind, detail or kind.title, instance, headers=headers)
    phrase = HTTPStatus(status).phrase
    body = {"type": "about:blank", "title": phrase, "status": status, "detail": detail, "instance": quote(instance)}
    return ProblemResponse(body, status, headers)


def _invalid(request: Request, errors: list[dict[str, str]]) -> JSONResponse:
    detail = f"{errors[0]['field']}: {errors[0]['message']}" if errors else VALIDATION.title
    return problem_response(VALIDATION, detail, request.url.path, errors=errors)


def _field_error(error: Mapping[str, Any]) -> dict[str, str]:
    if error["type"] == "json_invalid":
        reason = error.get("ctx", {}).get("error", "is malformed")
        return {"field": "body", "message": f"is not JSON: {reason} (character {error['loc'][-1]})"}
    field = ".".join(str(part) for part in error["loc"])
    return {"field": field, "message": error["msg"].removeprefix("Value error, ")}


def _methods(request: Request) -> list[str]:
    """Methods that the path of a request takes, whichever of several routes takes them."""
    return [
        method
        for method in _METHODS
        if any(r.matches({**request.scope, "method": method})[0] is Match.FULL for r in request.app.router.routes)
    ]
