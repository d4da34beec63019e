"""The camera library, and a rig of emulated devices over the real drivers."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from emulated_rig import EmulatedRig

from drivers.aravis.library import load_library
from drivers.errors import DeviceUnavailableError


@pytest.fixture(scope="session")
def camera_library() -> None:
    """Skips without libaravis; CI must have it."""
    try:
        load_library("camera")
    except DeviceUnavailableError:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip("libaravis is not installed")


@pytest.fixture
def emulated(camera_library: None) -> Iterator[EmulatedRig]:
    """Wired as it should be, devices closed."""
    with EmulatedRig() as made:
        yield made
