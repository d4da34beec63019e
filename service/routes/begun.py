"""Answers of operations that start a job."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import Response
from pydantic import BaseModel

from service.context import Service
from service.idempotency import answer_once
from service.jobs.record import JobRecord
from service.routes.jobs import JobView


def begun(
    service: Service,
    response: Response,
    key: str | None,
    operation: str,
    request: BaseModel,
    begin: Callable[[str], JobRecord],
) -> JobView:
    """The job just queued, or as it was when this request came first. begin: gets the id that it is to have."""
    body, repeated = answer_once(service.library, key, operation, request, lambda planned: JobView.of(begin(planned)))
    view = JobView.model_validate(body)
    response.headers["Location"] = view.links["self"]
    if repeated:
        response.headers["Idempotency-Replayed"] = "true"
    return view
