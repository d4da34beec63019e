"""The Spinnaker driver keeps the contract of cameras, with a stand-in for PySpin."""

from __future__ import annotations

import pytest
from fake_pyspin import FakeDevice
from fake_pyspin_nodes import IO, TIMEOUT

from drivers.genicam import GenicamConfiguration
from drivers.spinnaker import SpinnakerCamera
from drivers.testing import CameraBench, CameraContract


class TestSpinnakerCamera(CameraContract):
    @pytest.fixture(params=[IO, TIMEOUT], ids=["removal breaks the stream", "removal is silence"])
    def bench(self, request: pytest.FixtureRequest, device: FakeDevice) -> CameraBench:
        device.removal_error = request.param
        camera = SpinnakerCamera("left camera", GenicamConfiguration(serial=device.serial))
        return CameraBench(camera, device.pulse, device.unplug, device.plug)
