"""The library, which CI must have, and simulated cameras on addresses of their own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.gigevision import SimulatedGrasshopper

SERIAL = "20497219"


@pytest.fixture
def address() -> Callable[[int], str]:
    """Loopback addresses that no other test process uses: the port of GigE Vision is fixed."""
    process = os.getpid()
    return lambda index: f"127.{process >> 14 & 0x7F | 0x80}.{process >> 7 & 0x7F}.{2 * (process & 0x7F) + index}"


@pytest.fixture
def grasshopper(aravis: None, address: Callable[[int], str]) -> Iterator[SimulatedGrasshopper]:
    """One simulated camera, freshly switched on."""
    with SimulatedGrasshopper(address(0), SERIAL) as camera:
        yield camera


@pytest.fixture
def open_files() -> Callable[[], int]:
    """Counts this process's open files."""
    return lambda: len(list(Path("/proc/self/fd").iterdir()))
