"""The Aravis driver keeps the contract of cameras, through the real library and a simulated GigE Vision camera."""

from __future__ import annotations

import pytest

from drivers.aravis import AravisCamera
from drivers.genicam import GenicamConfiguration
from drivers.gigevision import SimulatedGrasshopper
from drivers.testing import CameraBench, CameraContract


class TestAravisCamera(CameraContract):
    @pytest.fixture
    def bench(self, grasshopper: SimulatedGrasshopper) -> CameraBench:
        configuration = GenicamConfiguration.model_validate({"address": grasshopper.address})
        camera = AravisCamera("left camera", configuration)
        return CameraBench(camera, lambda: _pulse(grasshopper), grasshopper.unplug, grasshopper.plug)


def _pulse(grasshopper: SimulatedGrasshopper) -> None:
    grasshopper.pulse()
