"""Captures from elsewhere: the one operation that takes a large body."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from service.context import ServiceDep
from service.library import ArchiveError
from service.routes.documented import problems
from service.routes.media_type import media_type_of
from service.views import CaptureView

router = APIRouter(prefix="/v1/captures", tags=["captures"])
_MEDIA_TYPES = ("application/zip", "application/x-zip-compressed", "application/octet-stream")


@router.post(
    "/import",
    operation_id="importCapture",
    summary="Add a capture from a zip archive",
    status_code=201,
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"application/zip": {"schema": {"type": "string", "format": "binary"}}},
        }
    },
    responses=problems(413, 415, 422, 507),
)
async def import_capture(request: Request, service: ServiceDep, response: Response) -> CaptureView:
    media_type = media_type_of(request)
    if media_type not in _MEDIA_TYPES:
        raise HTTPException(415, f"the body is '{media_type or 'untyped'}'; send the zip itself as application/zip")
    with tempfile.NamedTemporaryFile(dir=service.library.work, suffix=".zip") as file:
        try:
            async for chunk in request.stream():
                service.library.require_space(len(chunk))
                await run_in_threadpool(file.write, chunk)
        except ClientDisconnect:
            raise ArchiveError("the upload ended before its end; send it again") from None
        file.flush()
        stored = await run_in_threadpool(service.library.captures.import_archive, Path(file.name))
    view = CaptureView.of(stored)
    response.headers["Location"] = view.links["self"]
    return view
