"""The main call: one request, one exposure, one cloud."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi.responses import FileResponse

from service.context import ServiceDep
from service.idempotency import IdempotencyKey, answer_once
from service.reconstructions import CaptureAndReconstructionRequest, capture_and_reconstruct
from service.routes.documented import problems
from service.routes.reconstructions import MEDIA_TYPES, file_of
from service.views import CaptureAndReconstructionAnswer

router = APIRouter(prefix="/v1", tags=["capture and reconstruct"])
PLY = MEDIA_TYPES["ply"]


@router.post(
    "/capture-and-reconstruct",
    operation_id="captureAndReconstruct",
    summary="Take a capture and reconstruct it",
    status_code=201,
    response_model=CaptureAndReconstructionAnswer,
    responses={
        201: {
            "description": "Links, timings, statistics; with 'Accept: application/vnd.ply' the cloud itself.",
            "content": {PLY: {"schema": {"type": "string", "format": "binary"}}},
        },
        **problems(409, 422, 502, 503, 507),
    },
)
def create(
    service: ServiceDep,
    response: Response,
    request: CaptureAndReconstructionRequest | None = None,
    idempotency_key: IdempotencyKey = None,
    accept: Annotated[str, Header(include_in_schema=False)] = "*/*",
) -> CaptureAndReconstructionAnswer | FileResponse:
    request = request or CaptureAndReconstructionRequest.model_validate({})
    body, repeated = answer_once(
        service.library,
        idempotency_key,
        "capture-and-reconstruct",
        request,
        lambda planned: capture_and_reconstruct(service, request, planned),
    )
    answer = CaptureAndReconstructionAnswer.model_validate(body)
    headers = {"Location": answer.links["self"]}
    if repeated:
        headers["Idempotency-Replayed"] = "true"
    if PLY in accept:
        file = file_of(service, answer.reconstruction.id, "points.ply", download=True)
        file.status_code = 201
        file.headers.update(headers)
        file.headers["Link"] = f'<{answer.links["capture"]}>; rel="source"'
        return file
    response.headers.update(headers)
    return answer
