"""Evaluations of methods."""

from __future__ import annotations

from fastapi import APIRouter, Response

from service.context import ServiceDep
from service.idempotency import IdempotencyKey
from service.jobs.requests import EvaluationJobRequest
from service.routes.begun import begun
from service.routes.documented import problems
from service.routes.jobs import JobView

router = APIRouter(prefix="/v1/evaluations", tags=["jobs"])


@router.post(
    "",
    operation_id="createEvaluation",
    summary="Compare methods on a split, as a job",
    description="Queues what `duofringe evaluate` does, on a dataset or on captures of the library. When the job is "
    "done, it has the tables, and `result` of its links all figures.",
    status_code=202,
    responses=problems(404, 409, 422, 429, 503, 507),
)
def create(
    request: EvaluationJobRequest, service: ServiceDep, response: Response, idempotency_key: IdempotencyKey = None
) -> JobView:
    return begun(
        service,
        response,
        idempotency_key,
        "evaluations",
        request,
        lambda planned: service.jobs.evaluate(request, planned),
    )
