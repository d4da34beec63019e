"""The replay of a recorded capture keeps the contract of cameras and projectors."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test
from small_scene import small_rig
from virtual_benches import both_benches, camera_bench, projector_bench

from drivers.devices import RigDevices
from drivers.replay.source import ReplaySource
from drivers.simulator.mix import random_scene
from drivers.testing import CameraBench, CameraContract, ProjectorBench, ProjectorContract, RigContract, camera_machine
from drivers.virtual.rig import virtual_rig
from models.capture import write_capture
from models.patterns import make_plan


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ReplaySource:
    """One recorded capture of the full plan."""
    folder = tmp_path_factory.mktemp("recorded") / "one"
    rig = small_rig()
    write_capture(rig.render(random_scene(1, 0, rig.rig), make_plan("full"), 1), folder)
    return ReplaySource(folder)


@pytest.fixture
def replayed(source: ReplaySource) -> Callable[[bool], RigDevices]:
    """A new virtual rig before the capture, in real time or not."""
    return lambda realtime: virtual_rig(source, realtime=realtime)


class TestReplayedCamera(CameraContract):
    @pytest.fixture
    def bench(self, replayed: Callable[[bool], RigDevices]) -> CameraBench:
        return camera_bench(replayed(False))


class TestReplayedProjector(ProjectorContract):
    @pytest.fixture
    def bench(self, replayed: Callable[[bool], RigDevices]) -> ProjectorBench:
        return projector_bench(replayed(True))


class TestReplayedRig(RigContract):
    @pytest.fixture
    def rig(self, replayed: Callable[[bool], RigDevices]) -> RigDevices:
        return replayed(False)


def test_a_random_walk_over_replayed_devices(replayed: Callable[[bool], RigDevices]) -> None:
    machine = camera_machine(lambda: both_benches(replayed(False)))
    run_state_machine_as_test(machine, settings=settings(machine.TestCase.settings, max_examples=40))
