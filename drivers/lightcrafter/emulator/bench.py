"""An emulated controller with the flash that a manifest describes."""

from __future__ import annotations

from typing import Any

from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.manifest import FlashManifest
from models.patterns import Raster


def emulated_controller(manifest: FlashManifest, raster: Raster | None = None, **settings: Any) -> EmulatedController:
    """raster: of its mirrors, default those of the manifest. settings: of EmulatedController."""
    flash = EmulatedFlash([manifest.render(k, raster) for k in range(manifest.images)])
    return EmulatedController(flash, **settings)
