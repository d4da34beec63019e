"""The simulated scene before virtual devices."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.camera import AppliedSettings, BitDepth, CameraInfo, CameraLimits, CameraSettings
from drivers.errors import DeviceNotFoundError
from drivers.projector import ProjectorInfo
from drivers.simulator.mix import random_scene
from drivers.simulator.optics import Float32Array
from drivers.simulator.projected import MirrorLevels
from drivers.simulator.rig import Observation, SimulatedRig
from drivers.simulator.sensor import Sensor
from drivers.virtual.source import PixelFormat
from models.capture import Image, Truth
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import Pattern, PatternPlan

CAMERA_LIMITS = CameraLimits(exposure_us=(20.0, 350_000.0), gain_db=(0.0, 24.0), bit_depths=(8, 12))
_SCENE_NAME = re.compile(r"[0-9]{1,6}")
_LISTED_SCENES = 12
_DARK = "projector off"


class SimulatedSource:
    """Implements SceneSource on the seeded series ``random_scene(seed, index)``; a scene's name is its index.

    Rays are cast once a scene, when something is first asked of it. Noise depends on the seed, the scene and how many
    exposures a camera made, so that a fresh source gives the same images in the same order.
    """

    def __init__(self, seed: int = 0, scene: int = 0, rig: SimulatedRig | None = None) -> None:
        self._seed = seed
        self._simulated = rig or SimulatedRig()
        self._lock = threading.RLock()
        self._index = scene
        self._observed: Observation | None = None
        self._light: dict[tuple[Side, str], Float32Array] = {}

    @property
    def scenes(self) -> Sequence[str]:
        return tuple(str(index) for index in range(_LISTED_SCENES))

    @property
    def scene(self) -> str:
        return str(self._index)

    def place(self, name: str | None = None) -> str:
        if name is None:
            return self.scene
        if _SCENE_NAME.fullmatch(name) is None:
            raise DeviceNotFoundError("simulated scene", f"{name[:40]!r} is none; scenes are named 0, 1, ... 999999")
        with self._lock:
            if int(name) != self._index:
                self._index = int(name)
                self._observed = None
                self._light.clear()
            return self.scene

    @property
    def calibration(self) -> Rig | None:
        return self._simulated.rig

    @property
    def truth(self) -> Truth | None:
        return self._observation().truth

    @property
    def provenance(self) -> dict[str, Any]:
        return {"seed": self._seed, "scene": self._index}

    @property
    def object_id(self) -> str | None:
        return self._observation().scene.object_id

    def camera_info(self, side: Side) -> CameraInfo:
        record = next(r for r in self._simulated.device_records if r.role == side)
        return CameraInfo(
            driver=record.driver,
            model=record.model,
            serial=record.serial,
            firmware=record.firmware,
            origin="simulated",
            size=self._simulated.rig.cameras[side].size,
            limits=CAMERA_LIMITS,
        )

    @property
    def projector_info(self) -> ProjectorInfo:
        record = next(r for r in self._simulated.device_records if r.role == "projector")
        return ProjectorInfo(
            driver=record.driver,
            model=record.model,
            serial=record.serial,
            firmware=record.firmware,
            origin="simulated",
            raster=self._simulated.raster,
        )

    def pixel_format(self, side: Side, bit_depth: BitDepth) -> PixelFormat:
        sensor = replace(self._simulated.sensor, bit_depth=bit_depth)
        return PixelFormat(self._simulated.rig.cameras[side].size, bit_depth, sensor.white_level)

    def prepare(self, plan: PatternPlan) -> None:
        with self._lock:
            wanted = {(side, _key(pattern)): pattern for pattern in plan.patterns for side in SIDES}
            self._light = {key: light for key, light in self._light.items() if key in wanted or key[1] == _DARK}
            for (side, _), pattern in wanted.items():
                self._light_of(side, pattern)

    def image(
        self, side: Side, pattern: Pattern, settings: AppliedSettings, *, lit_us: float, brightness: float, shot: int
    ) -> Image:
        return self._expose(side, pattern, settings, brightness * lit_us / settings.exposure_us, shot)

    def view(
        self, side: Side, pattern: Pattern | None, settings: AppliedSettings, *, brightness: float, shot: int
    ) -> Image:
        return self._expose(side, pattern, settings, brightness, shot)

    def exposed_to(
        self,
        side: Side,
        name: str,
        levels: Callable[[], MirrorLevels] | None,
        settings: CameraSettings,
        *,
        share: float,
        shot: int,
    ) -> Image:
        """One exposure (height, width) while the mirrors hold ``levels`` (rows, columns), uint8; None for dark.

        name: stands for the levels, which are asked for where that name is new. share: of the projector's full light,
        over the whole exposure. shot: as in ``image``.
        """
        with self._lock:
            ambient = self._light_of(side, None)
            light = ambient
            if levels is not None and share > 0:
                key = (side, name)
                if key not in self._light:
                    self._light[key] = self._observation().light_of_image(side, levels())
                light = ambient + np.float32(share) * (self._light[key] - ambient)
            return self._observation().read_out(
                side, light, name, (self._seed, self._index, shot), self._sensor(settings)
            )

    def _expose(self, side: Side, pattern: Pattern | None, settings: AppliedSettings, share: float, shot: int) -> Image:
        """share: how much of the projector's light counts against the ambient light, which fills the exposure."""
        with self._lock:
            light = self._light_of(side, pattern)
            if share != 1.0 and pattern is not None:
                ambient = self._light_of(side, None)
                light = ambient + np.float32(share) * (light - ambient)
            name = _DARK if pattern is None else pattern.name
            seeds = (self._seed, self._index, shot)
            return self._observation().read_out(side, light, name, seeds, self._sensor(settings))

    def _sensor(self, settings: AppliedSettings | CameraSettings) -> Sensor:
        return replace(
            self._simulated.sensor,
            exposure_us=settings.exposure_us,
            gain_db=settings.gain_db,
            bit_depth=12 if settings.bit_depth == 12 else 8,
        )

    def _light_of(self, side: Side, pattern: Pattern | None) -> Float32Array:
        key = (side, _DARK if pattern is None else _key(pattern))
        if key not in self._light:
            self._light[key] = self._observation().light(side, pattern)
        return self._light[key]

    def _observation(self) -> Observation:
        with self._lock:
            if self._observed is None:
                scene = random_scene(self._seed, self._index, self._simulated.rig)
                self._observed = self._simulated.observe(scene)
            return self._observed


def _key(pattern: Pattern) -> str:
    return pattern.model_copy(update={"exposure_us": None}).model_dump_json()
