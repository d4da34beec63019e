"""Whatever goes wrong is told the same way: problem details with a type that answers."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest
from problem_checks import problem
from small_service import SmallService, small_service

from drivers.replay.source import ReplaySource
from service.problems import PROBLEM_TYPES

JSON = {"Content-Type": "application/json"}


def test_every_type_answers(lasting: SmallService) -> None:
    listed = lasting.client.get("/v1/problems").json()
    assert {kind["type"] for kind in listed} == {f"/v1/problems/{slug}" for slug in PROBLEM_TYPES}
    for kind in listed:
        found = lasting.client.get(kind["type"])
        assert found.status_code == 200
        assert found.json() == kind
        assert 400 <= kind["status"] < 600
        assert kind["remedy"]
    problem(lasting.client.get("/v1/problems/none"), 404, "not-found")


@pytest.mark.parametrize(
    "path", ["/", "/v1", "/v1/nothing", "/v2/captures", "/v1/rig/nothing", "/static-offline-docs/x"]
)
def test_an_unknown_path(lasting: SmallService, path: str) -> None:
    problem(lasting.client.get(path), 404, "not-found")


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "/v1/captures", "GET, POST"),
        ("DELETE", "/v1/rig", "GET"),
        ("POST", "/v1/captures/x", "GET, DELETE"),
        ("GET", "/v1/capture-and-reconstruct", "POST"),
        ("GET", "/v1/rig/projector", "PATCH"),
        ("BREW", "/v1/health/live", "GET"),
    ],
)
def test_an_unknown_method_tells_which_are_known(lasting: SmallService, method: str, path: str, allowed: str) -> None:
    response = lasting.client.request(method, path)
    problem(response, 405, "method-not-allowed")
    assert response.headers["allow"] == allowed


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ("{", "body"),
        ("", "body"),
        ("null", "body"),
        ("[]", "body"),
        ('"composite"', "body"),
        ("[" * 50_000 + "]" * 50_000, "body"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "body"),
        ('{"exposure_us": ' + "1" * 5000 + "}", "body"),
        ('{"exposure_us": NaN}', "body.exposure_us"),
        ('{"exposure_us": Infinity}', "body.exposure_us"),
        ('{"exposure_us": 1e999}', "body.exposure_us"),
        ('{"exposure_us": -1}', "body.exposure_us"),
        ('{"exposure_us": "long"}', "body.exposure_us"),
        ('{"exposure": 1}', "body.exposure"),
        ('{"plan": 7}', "body.plan"),
        ('{"plan": NaN}', "body.plan"),
        ('{"plan": [{"name": "composite", "kind": "sunny"}]}', "body.plan"),
        ('{"notes": "' + "x" * 4001 + '"}', "body.notes"),
        ('{"notes": "\\ud800"}', "body.notes"),
        ('{"object_id": ""}', "body.object_id"),
        ('{"\\ud800": 1}', "body"),
        (b'{"notes": "\xff"}', "body"),
        (b"\xff\xfe{}", "body"),
        (b"\x00", "body"),
    ],
)
@pytest.mark.parametrize("path", ["/v1/captures", "/v1/capture-and-reconstruct"])
def test_a_body_that_is_not_a_request(lasting: SmallService, path: str, content: str | bytes, field: str) -> None:
    before = lasting.bench.pulses_sent
    if path == "/v1/capture-and-reconstruct" and content in ("", "null"):
        return  # its body may be left out
    body = problem(lasting.client.post(path, content=content, headers=JSON), 422, "validation")
    assert body["errors"][0]["field"].startswith(field)
    assert all(set(error) == {"field", "message"} for error in body["errors"])
    assert lasting.bench.pulses_sent == before


@pytest.mark.parametrize("media_type", ["text/plain", "text/xml", "multipart/form-data; boundary=x", "a/b", None])
def test_a_body_of_another_type(lasting: SmallService, media_type: str | None) -> None:
    before = lasting.bench.pulses_sent
    headers = {} if media_type is None else {"Content-Type": media_type}
    for method, path in (
        ("POST", "/v1/captures"),
        ("POST", "/v1/capture-and-reconstruct"),
        ("POST", "/v1/reconstructions"),
        ("POST", "/v1/captures/import"),
        ("POST", "/v1/rig/assist"),
        ("PATCH", "/v1/rig/projector"),
    ):
        problem(lasting.client.request(method, path, content=b"{}", headers=headers), 415, "media-type")
    assert lasting.bench.pulses_sent == before


def test_json_with_parameters_or_of_a_kind_is_json(lasting: SmallService) -> None:
    for media_type in ("application/json; charset=utf-8", "Application/JSON", "application/merge-patch+json"):
        response = lasting.client.patch(
            "/v1/rig/projector", content=b'{"brightness": 1}', headers={"Content-Type": media_type}
        )
        assert response.status_code == 200, media_type


def _chunks(count: int) -> Iterator[bytes]:
    for _ in range(count):
        yield b" " * 65_536


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_over_the_limit(lasting: SmallService, declared: bool) -> None:
    limit = lasting.service.settings.server.max_body_bytes
    content = b" " * (limit + 1) if declared else _chunks(limit // 65_536 + 1)
    problem(lasting.client.post("/v1/captures", content=content, headers=JSON), 413, "too-large")
    within = json.dumps({"plan": "composite"}).encode().ljust(limit)
    assert lasting.client.post("/v1/captures", content=within, headers=JSON).status_code == 201


def test_an_upload_over_the_limit(recorded: Path, tmp_path: Path) -> None:
    limits = {"max_upload_bytes": 2 * 2**20}
    headers = {"Content-Type": "application/zip"}
    with small_service(ReplaySource(recorded), tmp_path / "library", server=limits) as small:
        for content in (b" " * (2 * 2**20 + 1), _chunks(40)):
            response = small.client.post("/v1/captures/import", content=content, headers=headers)
            problem(response, 413, "too-large")
        lie = {**headers, "Content-Length": str(10**12)}
        problem(small.client.post("/v1/captures/import", content=b"PK", headers=lie), 413, "too-large")
        response = small.client.post("/v1/captures/import", content=_chunks(20), headers=headers)
        problem(response, 422, "archive-invalid")  # more than other bodies may have
        assert list(small.service.library.work.iterdir()) == []


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example", "", "localhost:x:y", "127.0.0.1@evil"])
def test_a_host_that_is_not_served(lasting: SmallService, host: str) -> None:
    response = lasting.client.get("/v1/rig", headers={"Host": host})
    problem(response, 400, "bad-request")


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:8000", "127.0.0.1:1", "[::1]:8000"])
def test_a_host_that_is_served(lasting: SmallService, host: str) -> None:
    assert lasting.client.get("/v1/rig", headers={"Host": host}).status_code == 200


def test_pages_of_other_sites_move_nothing(lasting: SmallService) -> None:
    before = lasting.bench.pulses_sent
    for origin in ("https://evil.example", "null", "http://localhost:3000"):
        for path in ("/v1/capture-and-reconstruct", "/v1/rig/disconnect", "/v1/rig/assist"):
            problem(lasting.client.post(path, headers={"Origin": origin}), 403, "cross-origin")
    assert lasting.bench.pulses_sent == before
    assert lasting.client.get("/v1/rig").json()["connected"]
    assert lasting.client.post("/v1/capture-and-reconstruct", headers={"Origin": "http://localhost"}).status_code == 201


def test_an_error_of_the_service_itself_names_its_place_in_the_log(
    small: SmallService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a secret of the house")

    monkeypatch.setattr(small.service.orchestrator, "capture", fail)
    with caplog.at_level(logging.ERROR, "duofringe.service"):
        response = small.client.post("/v1/captures", json={}, headers={"Idempotency-Key": "bug"})
    body = problem(response, 500, "internal")
    assert "secret" not in response.text
    assert body["reference"] in body["detail"]
    assert any(body["reference"] in record.getMessage() and record.exc_info for record in caplog.records)
    monkeypatch.undo()
    assert small.client.post("/v1/captures", json={}, headers={"Idempotency-Key": "bug"}).status_code == 201


def test_errors_name_the_path_that_was_asked_for(lasting: SmallService) -> None:
    for path in ("/v1/captures/%C3%A9%20%22", "/v1/captures/%ff", "/v1/captures/a%3Fb"):
        response: httpx2.Response = lasting.client.get(path)
        assert response.status_code == 404
        instance = response.json()["instance"]
        assert instance.isascii()
        assert instance.startswith("/v1/captures/")
        assert " " not in instance
        assert "?" not in instance
