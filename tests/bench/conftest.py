"""A small virtual bench that all tests of a file share: each fault has to leave it usable."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from bench_rig import IMPATIENT, Bench
from small_rig import simulated_source

from drivers.bench import VirtualBench
from drivers.bench.devices import devices_of
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.request import CaptureRequest
from service.acquisition.settings import AcquisitionSettings


@pytest.fixture(scope="module")
def bench(aravis: None) -> Iterator[Bench]:
    """Warm, so that no test waits for rays to be cast."""
    virtual = VirtualBench(source=simulated_source())
    devices = devices_of(virtual, configuration=IMPATIENT)
    # one retake more than the faults need: a busy machine may spoil a sequence by itself
    orchestrator = Orchestrator(devices, AcquisitionSettings(retakes=2, late_s=0.3))
    assert virtual.source.truth is not None
    orchestrator.connect()
    orchestrator.capture(CaptureRequest(plan="full"))
    yield Bench(virtual, devices, orchestrator, Orchestrator(devices, AcquisitionSettings(retakes=0, late_s=0.3)))
    orchestrator.close()


@pytest.fixture(autouse=True)
def mended(request: pytest.FixtureRequest) -> Iterator[None]:
    """What one test leaves must not fail the next."""
    yield
    if "bench" in request.fixturenames:
        bench = request.getfixturevalue("bench")
        bench.virtual.mend()
        bench.orchestrator.connect()
