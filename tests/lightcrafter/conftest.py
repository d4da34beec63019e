"""Fixtures of the LightCrafter's tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from lightcrafter_benches import MANIFEST, Made, controller, usb_projector

from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter


@pytest.fixture
def make() -> Iterator[Callable[..., Made]]:
    """Makes a closed projector over USB; settings of the controller are told by their names."""
    projectors: list[LightCrafter] = []
    of_controller = {"realtime", "standby", "version", "two_image_quirk", "wake_s", "on_pulse"}

    def made(manifest: FlashManifest = MANIFEST, **settings: object) -> Made:
        emulated = {key: settings.pop(key) for key in list(settings) if key in of_controller}
        device = controller(**emulated)
        projectors.append(usb_projector(device, manifest, **settings))
        return projectors[-1], device

    yield made
    for projector in projectors:
        projector.close()
