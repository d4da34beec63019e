"""What the cameras of the bench see of what the emulated projector shows."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivers.camera import CameraSettings
from drivers.gigevision import SimulatedGrasshopper
from drivers.gigevision.pictures import ImageMaker
from drivers.gigevision.protocol import PIXEL_FORMATS
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.settings import LedLimits
from drivers.simulator.devices import SimulatedSource
from models.capture import Image
from models.geometry.rig import Side


@dataclass(frozen=True, eq=False)
class _Prepared:
    settings: CameraSettings
    share: float
    scene: str
    images: tuple[Image, ...]


class Sight:
    """Makes images, those of a sequence beforehand so that none is late for being slow to make.

    The light is that of the bits in the emulated flash that the LUT shows, driven by the LED currents that were set:
    ``full_drive`` of them is the lamp at its brightest.
    """

    def __init__(
        self,
        source: SimulatedSource,
        controller: EmulatedController,
        cameras: Mapping[Side, SimulatedGrasshopper],
        limits: LedLimits,
    ) -> None:
        self._source = source
        self._controller = controller
        self._cameras = cameras
        self._full_drive = sum(limits) / 255
        self._lock = threading.Lock()
        self._shots = 0
        self._prepared: dict[Side, _Prepared] = {}

    def white_level(self, side: Side) -> int:
        """Reading of a saturated pixel, as the camera is set now."""
        return int(2 ** self._settings(side).bit_depth - 1)

    def prepare(self, exposures: tuple[Exposure, ...]) -> None:
        """Make the images of a sequence for the settings that the cameras hold now."""
        with self._lock:
            self._shots += 1
            shot, scene = self._shots, self._source.scene
        for side in self._cameras:
            settings = self._settings(side)
            images = tuple(self._exposed(side, exposure, settings, exposure.lit_us, shot) for exposure in exposures)
            prepared = _Prepared(settings, self._brightness(exposures[0]), scene, images)
            with self._lock:
                self._prepared[side] = prepared

    def exposure(self, side: Side, exposure: Exposure) -> Image:
        """What an exposure sees that began with a pattern."""
        settings = self._settings(side)
        with self._lock:
            made = self._prepared.get(side)
        state = (settings, self._brightness(exposure), self._source.scene)
        if made is not None and state == (made.settings, made.share, made.scene) and exposure.index < len(made.images):
            return made.images[exposure.index]
        return self._exposed(side, exposure, settings, exposure.lit_us, self._shots)

    def belated(self, side: Side, following: Exposure | None) -> Image:
        """What an exposure sees that began as a pattern ended: the dark, then most of the following one."""
        settings = self._settings(side)
        if following is None:
            return self._source.exposed_to(side, "dark", None, settings, share=0, shot=self._shots)
        lit_us = min(following.lit_us, max(0.0, settings.exposure_us - following.dark_us))
        return self._exposed(side, following, settings, lit_us, self._shots)

    def now(self, side: Side) -> ImageMaker:
        """For exposures that no pulse began: whatever the projector shows as they are read out."""

        def make(index: int, exposure_us: float, gain_db: float) -> Image:
            settings = self._settings(side)
            showing = self._controller.showing
            with self._lock:
                self._shots += 1
                shot = self._shots
            if showing is not None:
                return self._exposed(side, showing, settings, settings.exposure_us, shot)
            light = self._controller.light().sum(axis=2) / self._full_drive
            if not light.any():
                return self._source.exposed_to(side, "dark", None, settings, share=0, shot=shot)
            levels = np.rint(np.clip(light, 0, 255)).astype(np.uint8)
            name = f"still {hash(levels.tobytes())}"
            return self._source.exposed_to(side, name, lambda: levels, settings, share=1, shot=shot)

        return make

    def _exposed(self, side: Side, exposure: Exposure, settings: CameraSettings, lit_us: float, shot: int) -> Image:
        share = self._brightness(exposure) * min(1.0, lit_us / settings.exposure_us)
        entry = exposure.entry
        name = f"image {exposure.image}, pattern {entry.number} of {entry.depth} bits, {entry.inverted}"
        return self._source.exposed_to(side, name, lambda: exposure.levels, settings, share=share, shot=shot)

    def _brightness(self, exposure: Exposure) -> float:
        return sum(self._controller.led_shares(exposure.entry.leds)) / self._full_drive

    def _settings(self, side: Side) -> CameraSettings:
        feature = self._cameras[side].feature
        return CameraSettings(
            exposure_us=feature("ExposureTime"),
            gain_db=feature("Gain"),
            bit_depth=8 if feature("PixelFormat") == PIXEL_FORMATS["Mono8"] else 12,
        )
