"""Requests drawn from the API's own description: no error of the service, and answers as they are described."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import schemathesis
from hypothesis import HealthCheck, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis.specs.openapi.checks import positive_data_acceptance
from small_service import SmallService, small_service
from starlette.types import ASGIApp, Receive, Scope, Send

from drivers.replay.source import ReplaySource

CASES = 20
HOSTS = {"allowed_hosts": ("localhost", "testserver")}
ENDLESS = "getStream"


@schemathesis.serializer("application/zip")
def as_sent(_: schemathesis.SerializationContext, value: object) -> bytes:
    """Uploads are drawn as bytes, and sent so."""
    return value if isinstance(value, bytes) else str(value).encode(errors="replace")


class Started:
    """An application that runs already: who starts or ends it once more changes nothing."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            await self.app(scope, receive, send)
            return
        for _ in ("startup", "shutdown"):
            await send({"type": (await receive())["type"] + ".complete"})


@pytest.fixture
def small(recorded: Path, tmp_path: Path) -> Iterator[SmallService]:
    with small_service(ReplaySource(recorded), tmp_path / "library", server=HOSTS) as running:
        assert running.client.post("/v1/capture-and-reconstruct").status_code == 201
        yield running


@pytest.mark.parametrize("mode", list(schemathesis.GenerationMode))
def test_any_request_is_answered_as_described(small: SmallService, mode: schemathesis.GenerationMode) -> None:
    schema = schemathesis.openapi.from_asgi("/openapi.json", Started(small.app))
    asked = 0
    for result in schema.get_all_operations():
        operation = result.ok()
        if operation.definition.raw["operationId"] == ENDLESS:
            continue
        small.service.orchestrator.connect()  # a drawn request may have closed it

        @seed(7)
        @settings(max_examples=CASES, deadline=None, database=None, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy(generation_mode=mode))
        def answered(case: schemathesis.Case) -> None:
            # what fits the description may still name a plan, cursor or key of nobody
            case.call_and_validate(excluded_checks=[positive_data_acceptance])

        with suppress(Unsatisfiable):  # nothing can be wrong about a request that takes next to nothing
            answered()
            asked += 1
    assert asked >= (25 if mode is schemathesis.GenerationMode.POSITIVE else 12)
    assert small.client.get("/v1/health/ready").json()["ready"]
    # drawn settings may have left an exposure that no pattern fits into
    assert small.client.post("/v1/captures", json={"exposure_us": 10_000}).status_code == 201
