"""Reconstructions: make, list, fetch as cloud or picture, delete."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse, HTMLResponse

from models.geometry.rig import Side
from service.context import ServiceDep
from service.idempotency import IdempotencyKey, answer_once
from service.reconstructions import ReconstructionRequest, reconstruct_stored
from service.routes.captures import Cursor, PageSize
from service.routes.documented import files, problems
from service.routes.links import next_link
from service.views import ReconstructionPage, ReconstructionView

router = APIRouter(prefix="/v1/reconstructions", tags=["reconstructions"])
PointSuffix = Literal["ply", "pcd", "xyz", "npz", "glb"]
MEDIA_TYPES = {
    "ply": "application/vnd.ply",
    "pcd": "application/octet-stream",
    "xyz": "text/plain",
    "npz": "application/octet-stream",
    "glb": "model/gltf-binary",
    "tiff": "image/tiff",
    "png": "image/png",
}


@router.post(
    "",
    operation_id="createReconstruction",
    summary="Reconstruct a stored capture",
    status_code=201,
    responses=problems(404, 409, 422, 503, 507),
)
def create(
    request: ReconstructionRequest, service: ServiceDep, response: Response, idempotency_key: IdempotencyKey = None
) -> ReconstructionView:
    body, repeated = answer_once(
        service.library,
        idempotency_key,
        "reconstructions",
        request,
        lambda planned: reconstruct_stored(service, request, planned),
    )
    answer = ReconstructionView.model_validate(body)
    response.headers["Location"] = answer.links["self"]
    if repeated:
        response.headers["Idempotency-Replayed"] = "true"
    return answer


@router.get("", operation_id="listReconstructions", summary="Reconstructions, newest first", responses=problems(422))
def list_reconstructions(
    service: ServiceDep,
    response: Response,
    limit: PageSize = 50,
    cursor: Cursor = None,
    capture: Annotated[str | None, Query(max_length=64, description="Only those of this capture.")] = None,
) -> ReconstructionPage:
    page = service.library.reconstructions.page(limit, cursor, capture=capture)
    if page.next_cursor is not None:
        response.headers["Link"] = next_link(
            "/v1/reconstructions", limit=limit, cursor=page.next_cursor, capture=capture
        )
    return ReconstructionPage(items=[ReconstructionView.of(stored) for stored in page.items], next=page.next_cursor)


@router.get(
    "/{reconstruction_id}", operation_id="getReconstruction", summary="One reconstruction", responses=problems(404)
)
def get(reconstruction_id: str, service: ServiceDep) -> ReconstructionView:
    return ReconstructionView.of(service.library.reconstructions.get(reconstruction_id))


@router.get(
    "/{reconstruction_id}/points.{suffix}",
    operation_id="getPoints",
    summary="The cloud as a file; mm, left-camera frame (GLB: metres, y up)",
    response_class=FileResponse,
    responses={**files(*sorted({MEDIA_TYPES[suffix] for suffix in get_args(PointSuffix)})), **problems(404, 422)},
)
def points(reconstruction_id: str, suffix: PointSuffix, service: ServiceDep) -> FileResponse:
    return file_of(service, reconstruction_id, f"points.{suffix}", download=True)


@router.get(
    "/{reconstruction_id}/depth.{suffix}",
    operation_id="getDepth",
    summary="Depth map: float32 mm (TIFF, NaN where invalid) or colours (PNG)",
    response_class=FileResponse,
    responses={**files("image/tiff", "image/png"), **problems(404, 422)},
)
def depth(reconstruction_id: str, suffix: Literal["tiff", "png"], service: ServiceDep) -> FileResponse:
    return file_of(service, reconstruction_id, f"depth.{suffix}", download=suffix == "tiff")


@router.get(
    "/{reconstruction_id}/surface.png",
    operation_id="getSurfacePicture",
    summary="The surface, shaded by its normals",
    response_class=FileResponse,
    responses={**files("image/png"), **problems(404)},
)
def surface(reconstruction_id: str, service: ServiceDep) -> FileResponse:
    return file_of(service, reconstruction_id, "surface.png")


@router.get(
    "/{reconstruction_id}/phase/{carrier}/{side}.png",
    operation_id="getPhasePicture",
    summary="Wrapped phase of one view, in colours",
    response_class=FileResponse,
    responses={**files("image/png"), **problems(404)},
)
def phase(reconstruction_id: str, carrier: Literal["high", "low"], side: Side, service: ServiceDep) -> FileResponse:
    return file_of(service, reconstruction_id, f"phase/{carrier}/{side}.png")


@router.get(
    "/{reconstruction_id}/report",
    operation_id="getReport",
    summary="Settings, figures and pictures on one page",
    response_class=HTMLResponse,
    responses=problems(404),
)
def report(reconstruction_id: str, service: ServiceDep) -> HTMLResponse:
    page = service.library.reconstructions.report(reconstruction_id)
    return HTMLResponse(
        page, headers={"Content-Security-Policy": "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'"}
    )


@router.delete(
    "/{reconstruction_id}",
    operation_id="deleteReconstruction",
    summary="Delete a reconstruction",
    status_code=204,
    responses=problems(404),
)
def delete(reconstruction_id: str, service: ServiceDep) -> None:
    service.library.reconstructions.delete(reconstruction_id)


def file_of(service: ServiceDep, reconstruction_id: str, name: str, *, download: bool = False) -> FileResponse:
    """One of a reconstruction's files, made now if nobody asked for it before."""
    path = service.library.reconstructions.artefact(reconstruction_id, name)
    filename = f"{reconstruction_id}.{name.rpartition('.')[2]}" if download else None
    return FileResponse(path, media_type=MEDIA_TYPES[name.rpartition(".")[2]], filename=filename)
