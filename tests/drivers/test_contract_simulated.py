"""The simulated rig keeps the contract of cameras and projectors."""

from __future__ import annotations

import pytest
from small_scene import small_source
from virtual_benches import both_benches, camera_bench, projector_bench

from drivers.devices import RigDevices
from drivers.testing import (
    CameraBench,
    CameraContract,
    ProjectorBench,
    ProjectorContract,
    RigContract,
    camera_machine,
)
from drivers.virtual.rig import virtual_rig


class TestSimulatedCamera(CameraContract):
    @pytest.fixture(params=[False, True], ids=["at once", "in real time"])
    def bench(self, request: pytest.FixtureRequest) -> CameraBench:
        return camera_bench(virtual_rig(small_source(), realtime=request.param))


class TestSimulatedProjector(ProjectorContract):
    @pytest.fixture
    def bench(self) -> ProjectorBench:
        return projector_bench(virtual_rig(small_source()))


class TestSimulatedRig(RigContract):
    @pytest.fixture(params=[False, True], ids=["at once", "in real time"])
    def rig(self, request: pytest.FixtureRequest) -> RigDevices:
        return virtual_rig(small_source(), realtime=request.param)


TestSimulatedWalk = camera_machine(lambda: both_benches(virtual_rig(small_source(), realtime=False))).TestCase
