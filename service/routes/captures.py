"""Captures: take, list, look at, move between libraries, delete."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse, StreamingResponse

from models.geometry.rig import Side
from service.acquisition.request import CaptureRequest
from service.captures import already_stored, take
from service.context import Service, ServiceDep
from service.idempotency import IdempotencyKey, answer_once
from service.routes.documented import files, problems
from service.routes.links import next_link
from service.views import CaptureAnswer, CapturePage, CaptureView, Clocks

router = APIRouter(prefix="/v1/captures", tags=["captures"])
PageSize = Annotated[int, Query(ge=1, le=200, description="Most items a page.")]
Cursor = Annotated[str | None, Query(max_length=200, description="'next' of the page before.")]


@router.post(
    "",
    operation_id="createCapture",
    summary="Take a capture",
    status_code=201,
    responses=problems(409, 422, 502, 503, 507),
)
def create(
    request: CaptureRequest, service: ServiceDep, response: Response, idempotency_key: IdempotencyKey = None
) -> CaptureAnswer:
    body, repeated = answer_once(
        service.library, idempotency_key, "captures", request, lambda planned: _create(service, request, planned)
    )
    answer = CaptureAnswer.model_validate(body)
    response.headers["Location"] = answer.links["self"]
    if repeated:
        response.headers["Idempotency-Replayed"] = "true"
    return answer


def _create(service: Service, request: CaptureRequest, capture_id: str) -> CaptureAnswer:
    stored = already_stored(service, capture_id)
    if stored is not None:
        attempts = int(stored.extra.get("attempts", 1))
        view = CaptureView.of(stored).model_dump()
        return CaptureAnswer(**view, attempts=attempts, timings_s={}, clocks=Clocks(acquisition_s=0.0))
    started = time.perf_counter()
    outcome = take(service, request, capture_id)
    captured = time.perf_counter()
    stored = service.library.captures.add(outcome.capture, capture_id)
    timings = {**outcome.timings_s, "store": time.perf_counter() - captured, "total": time.perf_counter() - started}
    return CaptureAnswer(
        **CaptureView.of(stored).model_dump(),
        attempts=outcome.attempts,
        timings_s=timings,
        clocks=Clocks(acquisition_s=outcome.acquisition_s, result_s=timings["total"]),
    )


@router.get("", operation_id="listCaptures", summary="Captures, newest first", responses=problems(422))
def list_captures(
    service: ServiceDep,
    response: Response,
    limit: PageSize = 50,
    cursor: Cursor = None,
    plan: Annotated[str | None, Query(max_length=64)] = None,
    object_id: Annotated[str | None, Query(max_length=200)] = None,
) -> CapturePage:
    page = service.library.captures.page(limit, cursor, plan=plan, object_id=object_id)
    if page.next_cursor is not None:
        response.headers["Link"] = next_link(
            "/v1/captures", limit=limit, cursor=page.next_cursor, plan=plan, object_id=object_id
        )
    return CapturePage(items=[CaptureView.of(stored) for stored in page.items], next=page.next_cursor)


@router.get("/{capture_id}", operation_id="getCapture", summary="One capture", responses=problems(404))
def get(capture_id: str, service: ServiceDep) -> CaptureView:
    return CaptureView.of(service.library.captures.get(capture_id))


@router.get(
    "/{capture_id}/images/{side}/{pattern}.png",
    operation_id="getCaptureImage",
    summary="One recorded image",
    response_class=FileResponse,
    responses={**files("image/png"), **problems(404)},
)
def image(capture_id: str, side: Side, pattern: str, service: ServiceDep) -> FileResponse:
    return FileResponse(service.library.captures.image_path(capture_id, side, pattern), media_type="image/png")


@router.get(
    "/{capture_id}/archive.zip",
    operation_id="getCaptureArchive",
    summary="The capture's folder as a zip",
    response_class=StreamingResponse,
    responses={**files("application/zip"), **problems(404)},
)
def archive(capture_id: str, service: ServiceDep) -> StreamingResponse:
    stream = service.library.captures.archive(capture_id)
    headers = {
        "Content-Length": str(stream.size),
        "Content-Disposition": f'attachment; filename="{stream.name}"',
    }
    return StreamingResponse(stream.chunks, media_type="application/zip", headers=headers)


@router.delete(
    "/{capture_id}",
    operation_id="deleteCapture",
    summary="Delete a capture; reconstructions of it stay",
    status_code=204,
    responses=problems(404),
)
def delete(capture_id: str, service: ServiceDep) -> None:
    service.library.captures.delete(capture_id)
