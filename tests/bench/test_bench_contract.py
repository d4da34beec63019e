"""The devices on the bench keep the contract of rigs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from small_rig import simulated_source

from drivers.bench import VirtualBench
from drivers.bench.devices import devices_of
from drivers.devices import RigDevices
from drivers.testing import RigContract


class TestVirtualBench(RigContract):
    @pytest.fixture
    def rig(self, aravis: None) -> Iterator[RigDevices]:
        with VirtualBench(source=simulated_source()) as bench:
            assert bench.source.truth is not None
            yield devices_of(bench)
