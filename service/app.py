"""The HTTP application: routes, problems, limits, documentation that needs no internet."""

from __future__ import annotations

import importlib.metadata
import json
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http import HTTPStatus
from typing import Any

from fastapi import Depends, FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi_offline import FastAPIOffline
from starlette.concurrency import run_in_threadpool
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.registry import make_devices
from service import problems
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError
from service.acquisition.watch import RigWatch
from service.authentication import authenticate
from service.compute import ComputeLane
from service.context import Service
from service.jobs.jobs import Jobs
from service.library import Library, LibraryLimits
from service.routes import (
    capture_and_reconstruct,
    capture_import,
    captures,
    evaluations,
    health,
    jobs,
    preview,
    problem_types,
    reconstructions,
    rig,
    trainings,
)
from service.routes.documented import ANY_ERROR
from service.routes.media_type import require_json
from service.settings import ServiceSettings
from service.warm_up import warm_up
from service.weights import WeightsShelf

logger = logging.getLogger("duofringe.service")
_DESCRIPTION = (
    "Captures of a stereo-camera and projector rig, and their reconstruction. Lengths in mm, left-camera frame "
    "(x right, y down, z forward); phases in radians; exposures in microseconds; images (height, width)."
)
_ROUTERS = (health, rig, preview, captures, reconstructions, capture_and_reconstruct, trainings, evaluations, jobs)


def open_service(settings: ServiceSettings) -> Service:
    """Library, devices (not yet opened), compute lane, jobs. Raises DuofringeError in one line if one is unusable."""
    devices = make_devices(settings.rig)
    for warning in devices.warnings:
        logger.warning("%s", warning)
    compute = ComputeLane()
    weights = WeightsShelf(settings.library.weights, compute)
    try:
        library = Library.open(settings.library.folder, LibraryLimits(settings.library.minimum_free_bytes))
        try:
            opened_jobs = Jobs.open(library, weights, settings.library.datasets)
        except BaseException:
            library.close()
            raise
    except BaseException:
        devices.release()
        raise
    orchestrator = Orchestrator(devices, settings.acquisition)
    return Service(settings, orchestrator, library, compute, weights, RigWatch(orchestrator), opened_jobs)


def create_app(service: Service) -> FastAPI:
    """The application of one service, which it closes when it ends."""
    settings = service.settings
    app = FastAPIOffline(
        title="Duofringe",
        version=importlib.metadata.version("duofringe"),
        description=_DESCRIPTION,
        redoc_url=None,
        lifespan=_lifespan,
        responses=ANY_ERROR,
        max_body_size=settings.server.max_body_bytes,
    )
    app.state.service = service
    app.state.settings = settings
    app.include_router(
        capture_import.router,
        dependencies=[Depends(authenticate)],
        max_body_size=settings.server.max_upload_bytes,
    )
    for module in _ROUTERS:
        protected = [] if module is health else [Depends(authenticate), Depends(require_json)]
        app.include_router(module.router, dependencies=protected)
    app.include_router(problem_types.router)
    problems.install(app)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=_allowed_hosts(settings))
    with_plain_errors = app.build_middleware_stack
    # outside of the framework's own limit of bodies, which user middleware is not
    app.build_middleware_stack = lambda: PlainErrorsAsProblems(with_plain_errors())  # type: ignore[method-assign]
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]  # FastAPI's documented way to extend the schema
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    service: Service = app.state.service
    try:
        await run_in_threadpool(service.orchestrator.connect)
    except RigNotConnectedError as error:
        logger.warning("%s", error)
    await run_in_threadpool(warm_up, service)
    try:
        yield
    finally:
        await run_in_threadpool(service.close)


def _allowed_hosts(settings: ServiceSettings) -> list[str]:
    """Names that a request may address: a page elsewhere must not reach a loopback service under a name of its own."""
    if settings.server.is_loopback or "allowed_hosts" in settings.server.model_fields_set:
        return list(settings.server.allowed_hosts)
    return ["*"]  # keys guard it


def _openapi(app: FastAPI) -> dict[str, Any]:
    """The schema with the problem model, and problem+json alone as the type of errors."""
    if app.openapi_schema:
        return app.openapi_schema
    schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
    components = schema.setdefault("components", {}).setdefault("schemas", {})
    problem = problems.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    components |= problem.pop("$defs", {})
    components["Problem"] = problem
    for name in ("HTTPValidationError", "ValidationError"):
        components.pop(name, None)
    for operations in schema["paths"].values():
        for operation in operations.values():
            _only_problems(operation["responses"])
            if not app.state.settings.api_keys:
                operation.pop("security", None)
    if not app.state.settings.api_keys:
        schema["components"].pop("securitySchemes", None)
    app.openapi_schema = schema
    return schema


def _only_problems(responses: dict[str, Any]) -> None:
    for status, response in responses.items():
        if status == "default" or int(status) >= HTTPStatus.BAD_REQUEST:
            content = response.get("content", {})
            if "application/problem+json" in content or "HTTPValidationError" in json.dumps(content):
                response["content"] = ANY_ERROR["default"]["content"]


class PlainErrorsAsProblems:
    """Turns errors that the framework answers in plain text, before any handler, into problem details."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        held: Message | None = None

        async def watched(message: Message) -> None:
            nonlocal held
            if message["type"] == "http.response.start" and _is_plain_error(message):
                held = message
            elif held is None:
                await send(message)
            elif not message.get("more_body"):
                detail = message.get("body", b"").decode(errors="replace")
                response = problems.http_problem(held["status"], detail, scope["path"])
                await response(scope, receive, send)

        await self.app(scope, receive, watched)


def _is_plain_error(message: Message) -> bool:
    headers = dict(message.get("headers", ()))
    is_text = headers.get(b"content-type", b"").startswith(b"text/plain")
    return bool(message["status"] >= HTTPStatus.BAD_REQUEST and is_text)
