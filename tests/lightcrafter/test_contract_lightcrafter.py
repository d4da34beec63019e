"""The LightCrafter keeps the contract of projectors, over USB and over both bridges."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from lightcrafter_benches import MANIFEST, controller, quick, serial_port, usb_projector

from drivers.lightcrafter.projector import LightCrafter
from drivers.testing import ProjectorBench, ProjectorContract


class TestLightCrafterOverUsb(ProjectorContract):
    @pytest.fixture(params=["sequence", "video"])
    def bench(self, request: pytest.FixtureRequest) -> ProjectorBench:
        device = controller()
        projector = usb_projector(device, hold=request.param)
        return ProjectorBench(projector, lambda: device.pulses_sent, device.unplug, device.plug)


class TestLightCrafterOverI2c(ProjectorContract):
    @pytest.fixture(params=[("usb-iss", "sequence"), ("bus-pirate", "video")], ids="-".join)
    def bench(self, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ProjectorBench]:
        bridge, hold = request.param
        device = controller()
        with serial_port(device, bridge, tmp_path) as (transport, _):
            projector = LightCrafter(transport, MANIFEST, quick(hold=hold))
            yield ProjectorBench(projector, lambda: device.pulses_sent, device.unplug, device.plug)
            projector.close()
