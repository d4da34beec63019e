"""Services that the tests in this folder talk to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from small_rig import plate, simulated_source
from small_service import SmallService, small_service

from benchmarks.service_process import ServiceProcess
from drivers.replay.source import ReplaySource
from models.capture import write_capture


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two recorded captures of the plan full, "plate-1" and "plate-2"."""
    folder = tmp_path_factory.mktemp("recorded")
    for seed in (1, 2):
        capture = plate(seed)
        record = capture.record.model_copy(update={"id": f"plate-{seed}", "object_id": f"object {seed}"})
        write_capture(replace(capture, record=record), folder / f"plate-{seed}")
    return folder


@pytest.fixture(scope="session")
def lasting(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SmallService]:
    """Before recorded captures, for tests that care for nothing of it but refusals; nobody changes its settings."""
    with small_service(ReplaySource(recorded), tmp_path_factory.mktemp("lasting") / "library") as running:
        yield running


@pytest.fixture
def small(recorded: Path, tmp_path: Path) -> Iterator[SmallService]:
    """Before recorded captures, with an empty library."""
    with small_service(ReplaySource(recorded), tmp_path / "library") as running:
        yield running


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[SmallService]:
    """Before a simulated scene, with an empty library."""
    with small_service(simulated_source(), tmp_path / "library") as running:
        yield running


@pytest.fixture(scope="session")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceProcess]:
    """``duofringe serve`` with the simulated rig, in a process of its own."""
    limits = {"DUOFRINGE_SERVER__MAX_UPLOAD_BYTES": str(64 * 2**20)}
    with ServiceProcess(tmp_path_factory.mktemp("live"), ["--driver", "simulated"], limits) as process:
        yield process
