"""A job's own process, and what is told of how far it is."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel
from small_rig import small_rig

from drivers.simulator.dataset import simulate_dataset
from models.patterns import make_plan
from models.refiner import Refiner, RefinerConfiguration
from models.refiner.weights import load_weights, save_weights
from service.jobs.completion import publish, tidy
from service.jobs.errors import WeightsTakenError
from service.jobs.estimate import Estimate
from service.jobs.messages import MESSAGES, Failed, Stage
from service.jobs.order import Order
from service.jobs.process import COMMAND, JobProcess
from service.jobs.requests import EvaluationJobRequest, TrainingJobRequest
from service.jobs.work import newest_state, run_training

SMALL = RefinerConfiguration(image_widths=(8, 8, 16), guidance_widths=(4, 8, 8), head_widths=(8, 8), attention_heads=2)


def training(folder: Path) -> Order:
    """An order that takes for ever."""
    dataset = folder / "plates"
    simulate_dataset(dataset, 3, 3, make_plan("composite"), rig=small_rig())
    request = TrainingJobRequest(name="mine", datasets=("plates",), steps=1_000_000, pixels=2048)
    (folder / "job").mkdir()
    return Order(
        kind="training",
        folder=folder / "job",
        request=request.model_dump(mode="json"),
        datasets={"plates": dataset},
        weights=folder / "weights",
    )


def test_it_ends_with_the_service_and_not_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    order = training(tmp_path)
    with subprocess.Popen(COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(order.model_dump_json().encode() + b"\n")
        process.stdin.flush()
        for line in process.stdout:
            message = MESSAGES.validate_json(line)
            assert isinstance(message, Stage), message
            if message.text.startswith("step"):
                break
        for number in (signal.SIGTERM, signal.SIGINT):
            process.send_signal(number)
        for _ in range(2):
            assert process.stdout.readline()
        process.stdin.close()
        assert process.wait(20) == 1
    assert not (tmp_path / "job" / "weights").exists()


def test_what_it_says_names_things_as_the_request_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = training(tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "torch.py").write_text("raise SystemExit('not the program')")
    monkeypatch.chdir(tmp_path)
    process = JobProcess(order.model_copy(update={"datasets": {"cups": empty}}))
    (message,) = process.messages()
    assert "status 0" in process.ended()
    assert isinstance(message, Failed)
    assert message.reason.startswith("'cups' holds neither")
    inside = f"{tmp_path}/plates/samples/1: bad; see {tmp_path}/weights/mine and {tmp_path}/job/weights"
    assert order.public(inside) == "plates/samples/1: bad; see mine and weights"


def test_weights_are_published_once_and_take_no_name_of_others(tmp_path: Path) -> None:
    job, shelf = tmp_path / "job", tmp_path / "shelf"
    job.mkdir()
    save_weights(job / "weights", Refiner(SMALL), (9.0, 14.0), "label-free")
    request = TrainingJobRequest(name="mine", datasets=("plates",))
    order = Order(kind="training", folder=job, request=request.model_dump(mode="json"), weights=shelf)
    result = run_training(order, lambda text, share: None)  # what is trained already is left as it is
    for _ in range(2):
        publish(job, request, result, shelf)
    assert load_weights(shelf / "mine")[1].sha256 == result["weights"]["sha256"]
    with pytest.raises(WeightsTakenError, match="others took the name"):
        publish(job, request, {"weights": {"sha256": "0" * 64}}, shelf)
    tidy(job)
    assert not list(job.iterdir())
    assert [path.name for path in shelf.iterdir()] == ["mine"]


def test_only_states_that_can_be_read_are_gone_on_from(tmp_path: Path) -> None:
    assert newest_state(tmp_path / "absent") is None
    (tmp_path / "step-00000002").mkdir()
    (tmp_path / "step-00000002" / "state.json").write_text("{")
    assert newest_state(tmp_path) is None
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("request_", [TrainingJobRequest, EvaluationJobRequest])
def test_examples_are_requests(request_: type[BaseModel]) -> None:
    (example,) = request_.model_json_schema()["examples"]
    request_.model_validate(example)


def test_a_steady_job_is_foretold() -> None:
    estimate = Estimate()
    assert estimate.remaining_s(0.2, 100.0) is None
    assert estimate.remaining_s(0.4, 110.0) == pytest.approx(30.0)
    assert estimate.remaining_s(1.0, 140.0) == 0.0
    assert estimate.remaining_s(0.1, 141.0) is None
    assert estimate.remaining_s(0.5, 145.0) == pytest.approx(5.0)


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1e9)), max_size=20))
def test_what_is_foretold_is_never_negative(steps: list[tuple[float, float]]) -> None:
    estimate = Estimate()
    for share, now in steps:
        remaining = estimate.remaining_s(share, now)
        assert remaining is None or 0 <= remaining < float("inf")
