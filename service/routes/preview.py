"""The live view: one JPEG, or a stream of them; it pauses while a capture holds the rig."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Annotated

import cv2
import numpy as np
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response, StreamingResponse
from starlette.concurrency import run_in_threadpool

from models.capture import Image
from models.geometry.rig import Side
from service.acquisition.live import LiveFrame, LiveView
from service.acquisition.lock import RigBusyError
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError
from service.context import ServiceDep
from service.routes.documented import files, problems

router = APIRouter(prefix="/v1/rig/cameras", tags=["rig"])
_BOUNDARY = "duofringe-frame"
_POLL_S = 0.02
_FIRST_FRAME_S = 3.0
_QUALITY = 85
_SATURATED_BGR = (0, 0, 255)

MarkSaturated = Annotated[bool, Query(description="Paint pixels at full scale red.")]


@router.get(
    "/{side}/preview",
    operation_id="getPreview",
    summary="One live image (JPEG)",
    response_class=Response,
    responses={**files("image/jpeg"), **problems(409, 503)},
)
async def preview(side: Side, service: ServiceDep, mark_saturated: MarkSaturated = False) -> Response:
    orchestrator = service.orchestrator
    _require_free(orchestrator)
    with orchestrator.live.watch(side) as newest:
        until = time.monotonic() + _FIRST_FRAME_S
        while (live := newest()) is None:
            await asyncio.sleep(_POLL_S)
            if time.monotonic() > until:
                _require_free(orchestrator)
                raise RigBusyError("no frame came from the camera")
    content = await run_in_threadpool(jpeg, live.frame.image, live.white_level, mark_saturated)
    return Response(content, media_type="image/jpeg", headers={"Cache-Control": "no-store"})


@router.get(
    "/{side}/stream",
    operation_id="getStream",
    summary="Live images (MJPEG)",
    response_class=StreamingResponse,
    responses={**files("multipart/x-mixed-replace"), **problems(503)},
)
async def stream(
    side: Side, request: Request, service: ServiceDep, mark_saturated: MarkSaturated = False
) -> StreamingResponse:
    orchestrator = service.orchestrator
    if not orchestrator.connected:
        raise RigNotConnectedError(orchestrator.failures)
    parts = _parts(orchestrator.live, side, mark_saturated, request)
    media_type = f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
    return StreamingResponse(parts, media_type=media_type, headers={"Cache-Control": "no-store"})


async def _parts(live: LiveView, side: Side, mark_saturated: bool, request: Request) -> AsyncIterator[bytes]:
    """Each new frame once; nothing while a capture holds the rig."""
    last = 0
    with live.watch(side) as newest:
        while not live.closed:
            frame: LiveFrame | None = newest()
            if frame is None or frame.number == last:
                await asyncio.sleep(_POLL_S)
                if await request.is_disconnected():
                    return
                continue
            last = frame.number
            content = await run_in_threadpool(jpeg, frame.frame.image, frame.white_level, mark_saturated)
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(content)}\r\n\r\n"
            yield head.encode() + content + b"\r\n"


def _require_free(orchestrator: Orchestrator) -> None:
    if not orchestrator.connected:
        raise RigNotConnectedError(orchestrator.failures)
    if orchestrator.holder is not None:
        raise RigBusyError(orchestrator.holder)


def jpeg(image: Image, white_level: int, mark_saturated: bool = False) -> bytes:
    """A camera image (H, W) as JPEG, full scale white; saturated pixels red where asked."""
    picture = np.asarray(image if white_level == 255 else image * (255.0 / white_level), np.uint8)
    if mark_saturated:
        picture = np.repeat(picture[..., None], 3, axis=2)
        picture[image >= white_level] = _SATURATED_BGR
    encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return encoded.tobytes()
