"""``Idempotency-Key``: a request sent twice moves the rig once."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import httpx2
import pytest
from problem_checks import problem
from small_service import SmallService, small_service

from drivers.replay.source import ReplaySource
from drivers.virtual.faults import PlantedFault
from models.errors import ReconstructionError

OPERATIONS = ["/v1/captures", "/v1/capture-and-reconstruct"]


def post(small: SmallService, path: str, key: str, **request: object) -> httpx2.Response:
    return small.client.post(path, json=request, headers={"Idempotency-Key": key})


@pytest.mark.parametrize("path", OPERATIONS)
def test_the_same_request_gets_the_same_answer(small: SmallService, path: str) -> None:
    first = post(small, path, "k", notes="n")
    again = post(small, path, "k", notes="n")
    assert first.status_code == again.status_code == 201
    assert first.json() == again.json()
    assert "idempotency-replayed" not in first.headers
    assert again.headers["idempotency-replayed"] == "true"
    assert again.headers["location"] == first.headers["location"]
    assert small.bench.pulses_sent == 1
    assert len(small.folders) == 1
    other = post(small, path, "another", notes="n")
    assert other.json() != first.json()
    assert small.bench.pulses_sent == 2


def test_a_repeated_cloud_is_the_same_cloud(small: SmallService) -> None:
    headers = {"Idempotency-Key": "k", "Accept": "application/vnd.ply"}
    clouds = [small.client.post("/v1/capture-and-reconstruct", headers=headers).content for _ in range(2)]
    assert clouds[0] == clouds[1]
    assert small.bench.pulses_sent == 1


def test_a_reconstruction_is_made_once(small: SmallService) -> None:
    capture = post(small, "/v1/captures", "c").json()["id"]
    answers = [post(small, "/v1/reconstructions", "r", capture=capture).json() for _ in range(2)]
    assert answers[0] == answers[1]
    assert len(small.service.library.reconstructions) == 1


def test_the_assistant_looks_once(simulated: SmallService) -> None:
    answers = [post(simulated, "/v1/rig/assist", "a", apply=False) for _ in range(2)]
    assert answers[0].json() == answers[1].json()
    assert answers[1].headers["idempotency-replayed"] == "true"


@pytest.mark.parametrize("path", OPERATIONS)
def test_a_key_belongs_to_one_request(small: SmallService, path: str) -> None:
    assert post(small, path, "k").status_code == 201
    problem(post(small, path, "k", notes="other"), 422, "idempotency-key-reused")
    other = next(p for p in OPERATIONS if p != path)
    problem(post(small, other, "k"), 422, "idempotency-key-reused")
    assert small.bench.pulses_sent == 1


@pytest.mark.parametrize("path", OPERATIONS)
def test_a_request_under_way_is_not_begun_again(
    small: SmallService, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on = threading.Event(), threading.Event()
    capture = small.service.orchestrator.capture

    def slow(*arguments: Any, **options: Any) -> object:
        begun.set()
        assert go_on.wait(10)
        return capture(*arguments, **options)

    monkeypatch.setattr(small.service.orchestrator, "capture", slow)
    answers: list[httpx2.Response] = []
    asking = threading.Thread(target=lambda: answers.append(post(small, path, "k")))
    asking.start()
    try:
        assert begun.wait(10)
        refused = post(small, path, "k")
        problem(refused, 409, "idempotency-key-in-progress")
        assert int(refused.headers["retry-after"]) >= 1
        problem(post(small, path, "k", notes="other"), 422, "idempotency-key-reused")
    finally:
        go_on.set()
        asking.join(10)
    assert answers[0].status_code == 201
    assert post(small, path, "k").json() == answers[0].json()
    assert small.bench.pulses_sent == 1


@pytest.mark.parametrize("path", OPERATIONS)
def test_a_failed_request_gives_its_key_back(small: SmallService, path: str) -> None:
    small.bench.plant(PlantedFault("dropped", "left"))
    problem(post(small, path, "k"), 502, "capture-refused")
    assert post(small, path, "k", notes="even for another request").status_code == 201
    assert len(small.folders) == 1


def test_an_answer_outlives_the_service(recorded: Path, tmp_path: Path) -> None:
    with small_service(ReplaySource(recorded), tmp_path / "library") as first:
        answers = [post(first, path, path).json() for path in OPERATIONS]
    with small_service(ReplaySource(recorded), tmp_path / "library") as second:
        for path, answer in zip(OPERATIONS, answers, strict=True):
            again = post(second, path, path)
            assert again.json() == answer
            assert again.headers["idempotency-replayed"] == "true"
        assert second.bench.pulses_sent == 0
        assert len(second.folders) == 2


@pytest.mark.parametrize("path", OPERATIONS)
def test_a_service_that_died_after_storing_does_not_expose_again(
    recorded: Path, tmp_path: Path, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with small_service(ReplaySource(recorded), tmp_path / "library") as first:
        store = first.service.library.idempotency
        monkeypatch.setattr(store, "finish", lambda *_: (_ for _ in ()).throw(ReconstructionError("killed here")))
        monkeypatch.setattr(store, "abandon", lambda *_: None)
        post(first, path, "k")
        assert first.bench.pulses_sent == 1
        (made,) = first.folders
    with small_service(ReplaySource(recorded), tmp_path / "library") as second:
        answer = post(second, path, "k")
        assert answer.status_code == 201, answer.text
        body = answer.json()
        assert body.get("capture", body)["id"] == made
        assert second.bench.pulses_sent == 0
        assert second.folders == [made]
        assert post(second, path, "k").json() == body
        assert second.service.library.captures.get(made).damaged is None


@pytest.mark.parametrize("key", ["", "k" * 201])
def test_a_key_of_no_or_too_much_text_is_refused(small: SmallService, key: str) -> None:
    body = problem(post(small, "/v1/captures", key), 422, "validation")
    assert body["errors"][0]["field"] == "header.Idempotency-Key"


def test_a_key_may_be_any_text(small: SmallService) -> None:
    for key in (b"\xff\xe9", b"../../x", b'a b;c="d"'):
        responses = [
            small.client.post("/v1/captures", json={}, headers={b"Idempotency-Key": key, b"Accept": b"*/*"})
            for _ in range(2)
        ]
        assert responses[0].status_code == 201, responses[0].text
        assert responses[0].json() == responses[1].json()
    assert small.bench.pulses_sent == 3
