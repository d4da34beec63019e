"""Trainings and evaluations over REST: done, cancelled, killed, interrupted and resumed, and what is refused."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from problem_checks import problem
from small_rig import DEPTH_RANGE, small_rig
from small_service import SmallService, small_service

from drivers.replay.source import ReplaySource
from drivers.simulator.dataset import simulate_dataset
from models.patterns import make_plan
from models.refiner.weights import load_weights
from service.jobs.record import JobRecord

TRAININGS, EVALUATIONS, JOBS = "/v1/trainings", "/v1/evaluations", "/v1/jobs"
QUICK = {"steps": 1, "pixels": 2048}
LONG = {"steps": 1_000_000, "pixels": 2048, "checkpoint_every": 1}
ENDED = ("done", "failed", "cancelled", "interrupted")
_WAIT_S = 120.0
NOBODY = "0199c0de-7a11-7000-8000-000000000000"


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a job's process, which inherits it."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("job-data") / "plates"
    simulate_dataset(folder, 3, 3, make_plan("full"), rig=small_rig())
    return folder


@pytest.fixture
def here(recorded: Path, tmp_path: Path, dataset: Path) -> Iterator[SmallService]:
    """A service with an empty library and the dataset "plates"."""
    with opened(recorded, tmp_path, dataset) as running:
        yield running


def opened(recorded: Path, tmp_path: Path, dataset: Path) -> Any:
    folder = tmp_path / "library"
    (folder / "datasets").mkdir(parents=True, exist_ok=True)
    if not (folder / "datasets" / "plates").exists():
        (folder / "datasets" / "plates").symlink_to(dataset)
    return small_service(ReplaySource(recorded), folder)


def begun(small: SmallService, path: str, **request: Any) -> dict[str, Any]:
    response = small.client.post(path, json=request)
    assert response.status_code == 202, response.text
    job: dict[str, Any] = response.json()
    assert response.headers["location"] == job["links"]["self"] == f"{JOBS}/{job['id']}"
    return job


def look(small: SmallService, job: dict[str, Any]) -> dict[str, Any]:
    response = small.client.get(job["links"]["self"])
    assert response.status_code == 200
    assert str(small.service.library.root) not in response.text
    found: dict[str, Any] = response.json()
    return found


def wait(small: SmallService, job: dict[str, Any], until: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + _WAIT_S
    while not until(found := look(small, job)):
        assert time.monotonic() < deadline, found
        assert found["state"] not in ENDED, found
        time.sleep(0.05)
    return found


def ended(small: SmallService, job: dict[str, Any]) -> dict[str, Any]:
    return wait(small, job, lambda found: found["state"] in ENDED)


def folder_of(small: SmallService, job: dict[str, Any]) -> Path:
    return small.service.library.root / "jobs" / str(job["id"])


def states_of(small: SmallService, job: dict[str, Any]) -> list[Path]:
    return sorted((folder_of(small, job) / "weights.training" / "checkpoints").glob("step-*"))


def job_processes() -> list[int]:
    """Children of this process that carry out jobs."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError, IndexError):
            continue
        if any(b"service.jobs.child" in word for word in words) and parent == os.getpid():
            found.append(int(entry.name))
    return found


class TestDone:
    def test_weights_are_used_by_their_name_at_once(self, here: SmallService) -> None:
        job = begun(here, TRAININGS, datasets=["plates"], name="plates-1", **QUICK)
        assert (job["kind"], job["state"], job["result"]) == ("training", "queued", None)
        assert job["request"]["labels"] == "none"
        done = ended(here, job)
        assert (done["state"], done["share"], done["error"]) == ("done", 1.0, None)
        assert done["created"] <= done["started"] <= done["ended"]
        weights = done["result"]["weights"]
        assert (weights["name"], weights["variant"]) == ("plates-1", "label-free")
        assert done["result"]["validation"]["median_high"] > 0
        _, record = load_weights(here.service.library.root / "weights" / "plates-1")
        assert record.training["datasets"] == ["plates"]

        capture = here.client.post("/v1/captures", json={"plan": "full"}).json()["id"]
        request = {"capture": capture, "weights": "plates-1", "depth_range": DEPTH_RANGE}
        made = here.client.post("/v1/reconstructions", json=request)
        assert made.status_code == 201, made.text
        assert made.json()["weights"] == weights
        again = here.client.post(TRAININGS, json={"datasets": ["plates"], "name": "plates-1"})
        problem(again, 409, "weights-exist")
        problem(here.client.delete(job["links"]["self"]), 409, "job-state")
        assert sorted(p.name for p in folder_of(here, job).iterdir()) == ["job.json", "weights.training"]
        assert not states_of(here, job)
        problem(here.client.post(f"{job['links']['self']}/resume"), 409, "job-state")
        problem(here.client.get(f"{job['links']['self']}/result"), 404, "not-found")

        chosen = {"captures": [capture], "methods": ["wft", "refiner:plates-1"], "against": "wft"}
        told = ended(here, begun(here, EVALUATIONS, **chosen, depth_range=DEPTH_RANGE))
        assert told["state"] == "done", told
        assert (told["result"]["samples"], told["result"]["failed"]) == (1, 0)
        assert "refiner:plates-1" in told["result"]["tables"]
        response = here.client.get(told["links"]["result"])
        assert response.headers["content-type"] == "application/json"
        assert str(here.service.library.root.resolve()) not in response.text
        figures = response.json()
        assert {"wft", "refiner:plates-1", "nstep wrapped"} <= set(figures["rows"])
        assert figures["samples"][0]["sample"] == capture
        assert figures["differences"]["against"] == "wft"
        assert [item["id"] for item in here.client.get(JOBS).json()["items"]] == [told["id"], job["id"]]
        (folder_of(here, told) / "evaluation.json").unlink()
        problem(here.client.get(told["links"]["result"]), 422, "damaged")

    def test_a_request_sent_twice_begins_one_job(self, here: SmallService) -> None:
        request = {"dataset": "plates", "methods": ["wft"], "split": "val", "depth_range": DEPTH_RANGE}
        answers = [here.client.post(EVALUATIONS, json=request, headers={"Idempotency-Key": "k"}) for _ in range(2)]
        assert [answer.status_code for answer in answers] == [202, 202]
        assert answers[0].json() == answers[1].json()
        assert answers[1].headers["idempotency-replayed"] == "true"
        assert len(here.client.get(JOBS).json()["items"]) == 1
        other = {**request, "methods": ["wavelet1d"]}
        response = here.client.post(EVALUATIONS, json=other, headers={"Idempotency-Key": "k"})
        problem(response, 422, "idempotency-key-reused")
        done = ended(here, answers[0].json())
        assert done["state"] == "done", done
        assert here.client.get(done["links"]["result"]).json()["dataset"] == "plates"


class TestEndedEarly:
    def test_a_cancelled_job_leaves_nothing_and_the_next_one_runs(self, here: SmallService) -> None:
        first = begun(here, TRAININGS, datasets=["plates"], name="never", **LONG)
        waiting = [
            begun(here, EVALUATIONS, dataset="plates", methods=["wft"], split="val", depth_range=DEPTH_RANGE)
            for _ in range(2)
        ]
        request = {"datasets": ["plates"], "name": "never"}
        assert (
            "makes weights 'never' already"
            in problem(here.client.post(TRAININGS, json=request), 409, "weights-exist")["detail"]
        )
        wait(here, first, lambda found: bool(states_of(here, first)) and found["remaining_s"] is not None)
        assert here.client.post("/v1/captures", json={"plan": "composite"}).status_code == 201
        dropped = here.client.delete(waiting[0]["links"]["self"]).json()
        assert dropped["state"] == "cancelled"
        (process,) = job_processes()
        cancelled = here.client.delete(first["links"]["self"])
        assert cancelled.status_code == 200
        assert cancelled.json()["state"] == "cancelled"
        assert process not in job_processes()
        assert [path.name for path in folder_of(here, first).iterdir()] == ["job.json"]
        assert here.client.delete(first["links"]["self"]).json() == cancelled.json()
        problem(here.client.post(f"{first['links']['self']}/resume"), 409, "job-state")
        assert ended(here, waiting[1])["state"] == "done"
        assert look(here, waiting[0])["started"] is None
        assert not (here.service.library.root / "weights").exists()

    def test_a_killed_process_is_told_and_can_be_gone_on_from(self, here: SmallService) -> None:
        request = {"dataset": "plates", "methods": ["wft"], "split": "val", "depth_range": DEPTH_RANGE}
        job = begun(here, EVALUATIONS, **request)
        wait(here, job, lambda _: bool(job_processes()))
        os.kill(job_processes()[0], signal.SIGKILL)
        failed = ended(here, job)
        assert failed["state"] == "failed"
        assert "SIGKILL" in failed["error"]
        assert here.client.post(failed["links"]["resume"]).status_code == 202
        done = ended(here, job)
        assert (done["state"], done["error"]) == ("done", None)

    def test_what_a_person_can_mend_is_told_in_a_line(self, here: SmallService) -> None:
        capture = here.client.post("/v1/captures", json={"plan": ["white"]}).json()["id"]
        failed = ended(here, begun(here, TRAININGS, captures=[capture], name="mine", **QUICK))
        assert failed["state"] == "failed"
        assert capture in failed["error"]
        assert "composite" in failed["error"]
        assert "\n" not in failed["error"]


class TestRestart:
    def test_a_training_goes_on_to_the_weights_it_would_have_had(
        self, recorded: Path, tmp_path: Path, dataset: Path
    ) -> None:
        few = {"datasets": ["plates"], "pixels": 2048, "checkpoint_every": 1, "steps": 5}
        with opened(recorded, tmp_path, dataset) as before:
            job = begun(before, TRAININGS, name="mine", **few)
            waiting = begun(before, EVALUATIONS, dataset="plates", methods=["wft"], split="val")
            wait(before, job, lambda _: len(states_of(before, job)) >= 2)
        assert not job_processes()
        assert states_of(before, job)
        broken = states_of(before, job)[-1]
        (broken / "state.safetensors").write_bytes(b"half")
        with opened(recorded, tmp_path, dataset) as after:
            found = {item["id"]: item["state"] for item in after.client.get(JOBS).json()["items"]}
            assert found == {job["id"]: "interrupted", waiting["id"]: "interrupted"}
            assert after.client.delete(waiting["links"]["self"]).json()["state"] == "cancelled"
            resumed = after.client.post(look(after, job)["links"]["resume"])
            assert resumed.status_code == 202
            assert (resumed.json()["state"], resumed.json()["id"]) == ("queued", job["id"])
            done = wait(after, job, lambda item: item["state"] in ("done", "failed"))
            assert done["state"] == "done", done
            log = (folder_of(after, job) / "weights.training" / "log.csv").read_text().splitlines()
            assert [line.partition(",")[0] for line in log] == ["step", *(str(step) for step in range(5))]
            whole = ended(after, begun(after, TRAININGS, name="whole", **few))
            assert whole["result"]["weights"]["sha256"] == done["result"]["weights"]["sha256"]

    def test_a_job_that_a_killed_service_left_is_interrupted(
        self, recorded: Path, tmp_path: Path, dataset: Path
    ) -> None:
        left = [
            JobRecord(id=name, kind="evaluation", state=state, created="2026-01-02T03:04:05Z", request=request)  # type: ignore[arg-type]
            for name, state, request in (
                ("0199c0de-7a11-7000-8000-000000000001", "running", {"dataset": "plates", "methods": ["wft"]}),
                ("0199c0de-7a11-7000-8000-000000000002", "queued", {"dataset": "gone", "methods": ["wft"]}),
                ("0199c0de-7a11-7000-8000-000000000003", "done", {"dataset": "plates", "methods": ["wft"]}),
                ("0199c0de-7a11-7000-8000-000000000004", "failed", {"dataset": "plates", "methods": ["best"]}),
            )
        ]
        jobs = tmp_path / "library" / "jobs"
        for record in left:
            (jobs / record.id).mkdir(parents=True)
            (jobs / record.id / "job.json").write_text(record.to_json())
        (jobs / NOBODY).mkdir()
        (jobs / NOBODY / "job.json").write_text("{")
        with opened(recorded, tmp_path, dataset) as small:
            items = small.client.get(JOBS).json()["items"]
            assert [item["state"] for item in items] == ["failed", "done", "interrupted", "interrupted", "failed"]
            body = problem(small.client.post(items[0]["links"]["resume"]), 422, "damaged")
            assert "job.json: request.methods" in body["detail"]
            assert "damaged" in items[-1]["error"]
            problem(small.client.post(f"{JOBS}/{NOBODY}/resume"), 422, "damaged")
            assert small.client.delete(f"{JOBS}/{NOBODY}").status_code == 200
            assert small.client.post(items[2]["links"]["resume"]).status_code == 202
            failed = wait(small, items[2], lambda item: item["state"] == "failed")
            assert failed["error"] == "dataset 'gone' is unknown; there are plates"


class TestRefused:
    @pytest.mark.parametrize(
        "name", ["", ".", "..", "../plates", "a/b", "/tmp", "~", "plates\n", "plates\x00", "-x", "é", "x" * 65, 7, None]
    )
    def test_a_path_is_no_name(self, lasting: SmallService, name: object) -> None:
        problem(lasting.client.post(TRAININGS, json={"datasets": [name], "name": "x"}), 422, "validation")
        problem(lasting.client.post(EVALUATIONS, json={"dataset": name, "methods": ["wft"]}), 422, "validation")
        problem(lasting.client.post(TRAININGS, json={"datasets": ["plates"], "name": name}), 422, "validation")
        if name is not None:
            request = {"datasets": ["plates"], "name": "x", "adapt": name}
            problem(lasting.client.post(TRAININGS, json=request), 422, "validation")

    @pytest.mark.parametrize(
        "request_",
        [
            {},
            {"datasets": ["plates"], "captures": [NOBODY]},
            {"datasets": []},
            {"captures": []},
            {"datasets": ["plates"], "steps": 1_000_001},
            {"datasets": ["plates"], "steps": 0},
            {"datasets": ["plates"], "learning_rate": 1.0},
            {"datasets": ["plates"], "labels": "truth", "ablation": "A0"},
            {"datasets": ["plates"], "network": {}},
            {"datasets": ["x"] * 33},
        ],
    )
    def test_settings_of_a_training(self, lasting: SmallService, request_: dict[str, Any]) -> None:
        problem(lasting.client.post(TRAININGS, json={"name": "x", **request_}), 422, "validation")

    @pytest.mark.parametrize(
        "request_",
        [
            {"methods": []},
            {"methods": ["best"]},
            {"methods": ["wft:sim"]},
            {"methods": ["wft"], "depth_range": [600, 400]},
            {"methods": ["wft"], "against": "refiner"},
            {"methods": ["wft"], "matching": []},
            {"methods": ["wft"], "split": "../x"},
        ],
    )
    def test_settings_of_an_evaluation(self, lasting: SmallService, request_: dict[str, Any]) -> None:
        problem(lasting.client.post(EVALUATIONS, json={"dataset": "plates", **request_}), 422, "validation")

    def test_what_does_not_exist(self, here: SmallService) -> None:
        def training(**request: Any) -> httpx2.Response:
            return here.client.post(TRAININGS, json={"name": "x", **request})

        body = problem(training(datasets=["plates", "cups"]), 422, "dataset-unusable")
        assert body["detail"] == "dataset 'cups' is unknown; there are plates"
        problem(training(captures=[NOBODY]), 404, "not-found")
        problem(training(captures=["../../datasets/plates"]), 404, "not-found")
        problem(training(datasets=["plates"], adapt="mine"), 422, "weights-unusable")
        problem(training(datasets=["plates"], device="cuda:63"), 422, "request-failed")
        problem(training(datasets=["plates"], name="sim"), 409, "weights-exist")
        empty = here.service.library.root / "datasets" / "empty"
        empty.mkdir()
        body = problem(training(datasets=["empty"]), 422, "dataset-unusable")
        assert str(here.service.library.root) not in str(body)
        evaluation = {"dataset": "plates", "methods": ["wft"]}
        problem(here.client.post(EVALUATIONS, json={**evaluation, "split": "best"}), 422, "dataset-unusable")
        weights = {**evaluation, "methods": ["refiner:mine"]}
        problem(here.client.post(EVALUATIONS, json=weights), 422, "weights-unusable")
        for path in (NOBODY, "x", "..%2f..%2fetc"):
            problem(here.client.get(f"{JOBS}/{path}"), 404, "not-found")
        problem(here.client.delete(f"{JOBS}/{NOBODY}"), 404, "not-found")
        problem(here.client.post(f"{JOBS}/{NOBODY}/resume"), 404, "not-found")
        assert here.client.get(JOBS).json() == {"items": [], "next": None}

    def test_folders_without_a_record_are_names_too(self, here: SmallService) -> None:
        (here.service.library.root / "weights" / "half").mkdir(parents=True)
        problem(here.client.post(TRAININGS, json={"datasets": ["plates"], "name": "half"}), 409, "weights-exist")


def test_jobs_wait_up_to_a_limit_and_are_listed_by_pages(here: SmallService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.jobs.lane.JobLane._work", lambda lane: None)
    request = {"dataset": "plates", "methods": ["wft"]}
    made = [begun(here, EVALUATIONS, **request)["id"] for _ in range(16)]
    response = here.client.post(EVALUATIONS, json=request)
    problem(response, 429, "jobs-full")
    assert int(response.headers["retry-after"]) > 0
    seen, path = [], f"{JOBS}?limit=6"
    while path:
        page = here.client.get(path)
        seen += [item["id"] for item in page.json()["items"]]
        path = page.headers["link"].partition(">")[0].removeprefix("<") if "link" in page.headers else ""
    assert seen == made[::-1]
    assert here.client.delete(f"{JOBS}/{made[3]}").json()["state"] == "cancelled"
    assert here.client.post(EVALUATIONS, json=request).status_code == 202


def test_an_error_of_the_program_is_for_the_log_alone(
    here: SmallService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("a secret of the program")

    monkeypatch.setattr("service.jobs.sources.Sources.order", broken)
    job = begun(here, EVALUATIONS, dataset="plates", methods=["wft"])
    failed = ended(here, job)
    assert failed["state"] == "failed"
    assert "secret" not in failed["error"]
    assert failed["id"] in failed["error"]
    assert "a secret of the program" in caplog.text
    shutil.rmtree(folder_of(here, job))
    problem(here.client.get(job["links"]["self"]), 404, "not-found")
