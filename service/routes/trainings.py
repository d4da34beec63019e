"""Trainings of the refiner."""

from __future__ import annotations

from fastapi import APIRouter, Response

from service.context import ServiceDep
from service.idempotency import IdempotencyKey
from service.jobs.requests import TrainingJobRequest
from service.routes.begun import begun
from service.routes.documented import problems
from service.routes.jobs import JobView

router = APIRouter(prefix="/v1/trainings", tags=["jobs"])


@router.post(
    "",
    operation_id="createTraining",
    summary="Train the refiner, as a job",
    description="Queues what `duofringe train` does, on datasets or on captures of the library. When the job is done, "
    "`weights` of a reconstruction takes `name`.",
    status_code=202,
    responses=problems(404, 409, 422, 429, 503, 507),
)
def create(
    request: TrainingJobRequest, service: ServiceDep, response: Response, idempotency_key: IdempotencyKey = None
) -> JobView:
    return begun(
        service, response, idempotency_key, "trainings", request, lambda planned: service.jobs.train(request, planned)
    )
