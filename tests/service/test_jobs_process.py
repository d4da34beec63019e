"""A job's own process, and what is told of how far it is."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_rig import small_rig

from drivers.simulator.dataset import simulate_dataset
from models.patterns import make_plan
from service.jobs.estimate import Estimate
from service.jobs.messages import MESSAGES, Failed, Stage
from service.jobs.order import Order
from service.jobs.process import JobProcess
from service.jobs.requests import TrainingJobRequest


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
    with subprocess.Popen(
        [sys.executable, "-m", "service.jobs.child"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
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


def test_what_it_says_names_things_as_the_request_did(tmp_path: Path) -> None:
    order = training(tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    process = JobProcess(order.model_copy(update={"datasets": {"cups": empty}}))
    (message,) = process.messages()
    assert "status 0" in process.ended()
    assert isinstance(message, Failed)
    assert message.reason.startswith("'cups' holds neither")
    inside = f"{tmp_path}/plates/samples/1: bad; see {tmp_path}/weights/mine and {tmp_path}/job/weights"
    assert order.public(inside) == "plates/samples/1: bad; see mine and weights"


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
