"""The camera library, and a rig of emulated devices over the real drivers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from emulated_rig import EmulatedRig


@pytest.fixture
def emulated(aravis: None) -> Iterator[EmulatedRig]:
    """Wired as it should be, devices closed."""
    with EmulatedRig() as made:
        yield made
