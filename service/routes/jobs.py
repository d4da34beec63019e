"""Jobs: look at, cancel, resume."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from service.context import ServiceDep
from service.jobs.record import RESUMABLE, JobKind, JobRecord, JobState
from service.routes.captures import Cursor, PageSize
from service.routes.documented import problems
from service.routes.links import next_link
from service.views import Page

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


class JobView(BaseModel):
    """A training or an evaluation. request: as it was understood, with its defaults."""

    id: str
    kind: JobKind | None = Field(description="null where its record is damaged, as `error` then tells.")
    state: JobState = Field(examples=["running"])
    created: datetime
    started: datetime | None = None
    ended: datetime | None = None
    stage: str = Field("", examples=["step 120 of 800, loss 0.0312, 14 min 10 s left"])
    share: float = Field(0.0, ge=0, le=1, description="Of the stage under way.", examples=[0.15])
    remaining_s: float | None = Field(
        None, description="Seconds that the stage under way will take still; null before that can be told."
    )
    request: dict[str, Any]
    result: dict[str, Any] | None = Field(
        None,
        description="Of a training: name, variant and SHA-256 of its weights, and figures of their validation. Of an "
        "evaluation: its tables as text, and how many reconstructions failed.",
    )
    error: str | None = Field(None, description="Why it failed, in one line.")
    links: dict[str, str]

    @classmethod
    def of(cls, record: JobRecord) -> JobView:
        here = f"/v1/jobs/{record.id}"
        links = {"self": here}
        if record.kind is not None and record.state in RESUMABLE:
            links["resume"] = f"{here}/resume"
        if record.state == "done" and record.kind == "evaluation":
            links["result"] = f"{here}/result"
        return cls(**record.model_dump(exclude={"schema_"}), links=links)


class JobPage(Page):
    items: list[JobView]


@router.get(
    "",
    operation_id="listJobs",
    summary="Jobs, newest first",
    description="Trainings and evaluations of whatever state, a page at a time.",
    responses=problems(422),
)
def list_jobs(service: ServiceDep, response: Response, limit: PageSize = 50, cursor: Cursor = None) -> JobPage:
    page = service.jobs.page(limit, cursor)
    if page.next_cursor is not None:
        response.headers["Link"] = next_link("/v1/jobs", limit=limit, cursor=page.next_cursor)
    return JobPage(items=[JobView.of(record) for record in page.items], next=page.next_cursor)


@router.get(
    "/{job_id}",
    operation_id="getJob",
    summary="One job",
    description="Its state, how far it is, and its result or why it failed. What it tells is at most a second old.",
    responses=problems(404),
)
def get(job_id: str, service: ServiceDep) -> JobView:
    return JobView.of(service.jobs.get(job_id))


@router.get(
    "/{job_id}/result",
    operation_id="getJobResult",
    summary="All figures of an evaluation",
    description="The JSON that `duofringe evaluate --output` writes: rows, classes, differences, every sample.",
    response_class=FileResponse,
    responses={
        200: {"description": "The figures", "content": {"application/json": {"schema": {"type": "object"}}}},
        **problems(404, 422),
    },
)
def result(job_id: str, service: ServiceDep) -> FileResponse:
    return FileResponse(service.jobs.evaluation(job_id), media_type="application/json")


@router.delete(
    "/{job_id}",
    operation_id="cancelJob",
    summary="Cancel a job",
    description="Ends it if it runs, drops it if it waits, was interrupted or has failed, and removes what it has "
    "written. The job itself stays, as cancelled. One that is done is left alone (409).",
    responses=problems(404, 409),
)
def cancel(job_id: str, service: ServiceDep) -> JobView:
    return JobView.of(service.jobs.cancel(job_id))


@router.post(
    "/{job_id}/resume",
    operation_id="resumeJob",
    summary="Go on with a job that was interrupted or has failed",
    description="A training goes on from its newest state, to the very weights that it would have had; an evaluation "
    "begins anew.",
    status_code=202,
    responses=problems(404, 409, 422, 429, 507),
)
def resume(job_id: str, service: ServiceDep, response: Response) -> JobView:
    view = JobView.of(service.jobs.resume(job_id))
    response.headers["Location"] = view.links["self"]
    return view
