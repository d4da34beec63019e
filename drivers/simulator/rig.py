"""The simulated rig: what two cameras record while a projector shows a plan to a scene."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from drivers.simulator.bounce import view_bounce
from drivers.simulator.exposure import ExposureShares, exposure_shares, exposure_warnings
from drivers.simulator.geometry import reference_rig
from drivers.simulator.lamp import Lamp, Levels
from drivers.simulator.light import Footprints, ViewLight, view_light
from drivers.simulator.optics import Float32Array, Optics, Profile, blur_image, pattern_profile
from drivers.simulator.projected import MirrorLevels, light_of
from drivers.simulator.scene import Scene
from drivers.simulator.sensor import Sensor
from drivers.simulator.truth import scene_truth
from models.capture import Capture, CaptureRecord, DeviceRecord, Image, Truth
from models.errors import CalibrationError
from models.geometry.device import Device
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import Pattern, PatternPlan, Raster

A = TypeVar("A")
B = TypeVar("B")
SIMULATED_CLOCK = datetime(2000, 1, 1, tzinfo=UTC)
"""Every simulated capture bears this date, so that the same seed gives the same bytes."""


def _default_threads() -> int:
    return min(4, os.cpu_count() or 1)


def _seeds(seed: int | Sequence[int]) -> list[int]:
    return [seed] if isinstance(seed, int) else list(seed)


@dataclass(frozen=True, eq=False)
class Observation:
    """A scene as it stands before a rig's devices: ready to be exposed to any pattern."""

    simulated: SimulatedRig
    scene: Scene
    views: dict[Side, ViewLight]
    truth: Truth

    def light(self, side: Side, pattern: Pattern | None) -> Float32Array:
        """Light (H, W) on one sensor before its noise, 1 = white level; without a pattern the projector is off."""
        view = self.views[side]
        light = view.ambient if pattern is None else view.under(self.simulated.profile(pattern))
        return blur_image(light, self.simulated.optics.psf_px)

    def light_of_image(self, side: Side, levels: MirrorLevels) -> Float32Array:
        """The same while the projector's mirrors hold ``levels`` (rows, columns), uint8."""
        simulated = self.simulated
        projected = light_of(levels, simulated.raster, simulated.optics, simulated.rows_per_column)
        return blur_image(self.views[side].under(projected), simulated.optics.psf_px)

    def read_out(
        self, side: Side, light: Float32Array, name: str, seed: int | Sequence[int] = 0, sensor: Sensor | None = None
    ) -> Image:
        """The image (H, W), uint8 or uint16, that a sensor makes of light; noise depends on seed, side and name."""
        rng = np.random.default_rng([*_seeds(seed), SIDES.index(side), zlib.crc32(name.encode())])
        return (sensor or self.simulated.sensor).digitise(light, rng)

    def expose(
        self, side: Side, pattern: Pattern, seed: int | Sequence[int] = 0, sensor: Sensor | None = None
    ) -> Image:
        """One camera image (H, W), uint8 or uint16, of one pattern.

        The noise depends on the seed, the side and the pattern's name only. sensor: other settings than the rig's.
        """
        return self.read_out(side, self.light(side, pattern), pattern.name, seed, sensor)


@dataclass(frozen=True, eq=False)
class SimulatedRig:
    """A calibrated rig with optics, light and sensors of which everything is known.

    rig: must have a projector (CalibrationError otherwise). interreflection: add one diffuse bounce between surfaces.
    threads: for rays and images; the result does not depend on it.
    """

    rig: Rig = field(default_factory=reference_rig)
    optics: Optics = field(default_factory=Optics)
    sensor: Sensor = field(default_factory=Sensor)
    levels: Levels = field(default_factory=Levels)
    interreflection: bool = False
    threads: int = field(default_factory=_default_threads)
    _profiles: dict[str, Profile] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.rig.projector is None or self.rig.raster is None:
            raise CalibrationError("the simulated rig needs a calibration with a projector; this one has none")

    @property
    def projector(self) -> Device:
        assert self.rig.projector is not None
        return self.rig.projector

    @property
    def raster(self) -> Raster:
        assert self.rig.raster is not None
        return self.rig.raster

    @property
    def rows_per_column(self) -> float:
        """Column pitch over row pitch of the mirrors."""
        return self.projector.fy / self.projector.fx

    @cached_property
    def lamp(self) -> Lamp:
        return Lamp(self.projector, self.levels.lamp_scale(self.rig.left, self.projector))

    @cached_property
    def footprints(self) -> dict[Side, Footprints]:
        """Lines of sight of both cameras, computed once."""
        return {side: Footprints.of(camera, self.optics.footprint) for side, camera in self.rig.cameras.items()}

    def profile(self, pattern: Pattern) -> Profile:
        """The light of a pattern along u or v, computed once per rig."""
        key = pattern.model_dump_json()
        if key not in self._profiles:
            self._profiles[key] = pattern_profile(pattern, self.raster, self.optics, self.rows_per_column)
        return self._profiles[key]

    def prepare(self, plan: PatternPlan) -> None:
        """Compute now, rather than at the first capture and in several threads at once, what all captures share."""
        _ = self.footprints, self.lamp
        for pattern in plan.patterns:
            self.profile(pattern)

    def observe(self, scene: Scene) -> Observation:
        """Cast all rays of a scene."""
        ambient_scale = self.levels.ambient_scale(self.sensor.black_level)
        views = {side: view_light(scene, self.footprints[side], self.lamp, ambient_scale, self._each) for side in SIDES}
        if self.interreflection:
            cameras = self.rig.cameras
            views = {
                side: replace(view, bounce=view_bounce(scene, cameras[side], self.lamp, view.objects))
                for side, view in views.items()
            }
        return Observation(self, scene, views, scene_truth(scene, self.rig, self.lamp))

    def render(self, scene: Scene, plan: PatternPlan, seed: int | Sequence[int] = 0) -> Capture:
        """A capture of a scene under a plan, with its ground truth; the same arguments give the same bytes."""
        self.prepare(plan)
        observation = self.observe(scene)
        shots = [(side, pattern) for side in SIDES for pattern in plan.patterns]
        exposed = list(self._each(lambda shot: observation.expose(shot[0], shot[1], seed), shots))
        images: dict[Side, dict[str, Image]] = {side: {} for side in SIDES}
        for (side, pattern), image in zip(shots, exposed, strict=True):
            images[side][pattern.name] = image
        shares = {
            side: exposure_shares(images[side], view.white * self.sensor.amplification, self.sensor.white_level)
            for side, view in observation.views.items()
        }
        return Capture(
            plan,
            images,
            self.rig,
            self._record(scene, plan, shares),
            observation.truth,
            source=f"simulated capture of {scene.object_id}",
        )

    def _record(self, scene: Scene, plan: PatternPlan, shares: dict[Side, ExposureShares]) -> CaptureRecord:
        starts_us = np.cumsum([0.0, *(max(p.exposure_us or 0.0, self.sensor.exposure_us) for p in plan.patterns[:-1])])
        starts_ns = [round(1000 * t) for t in starts_us]
        settings: dict[str, Any] = {
            "exposure_us": self.sensor.exposure_us,
            "gain_db": self.sensor.gain_db,
            "exposure": {side: share.model_dump() for side, share in shares.items()},
            "sensor": asdict(self.sensor),
            "optics": asdict(self.optics),
            "levels": asdict(self.levels),
            "interreflection": self.interreflection,
            "traits": sorted(scene.traits),
        }
        return CaptureRecord(
            created=SIMULATED_CLOCK,
            devices=self.device_records,
            settings=settings,
            frame_ids={side: list(range(len(plan))) for side in SIDES},
            timestamps_ns=dict.fromkeys(SIDES, starts_ns),
            warnings=exposure_warnings(shares),
            object_id=scene.object_id,
            bit_depth=self.sensor.bit_depth,
            white_level=self.sensor.white_level,
        )

    @property
    def device_records(self) -> tuple[DeviceRecord, ...]:
        """The three devices as a capture names them."""
        mirrors = f"{self.raster.columns}x{self.raster.rows} {self.raster.kind}"
        models = {"left": "simulated mono camera", "right": "simulated mono camera", "projector": f"DMD {mirrors}"}
        return tuple(
            DeviceRecord.model_validate(
                {"role": role, "driver": "simulator", "model": model, "serial": f"SIM-{role}", "origin": "simulated"}
            )
            for role, model in models.items()
        )

    def _each(self, function: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
        """``map`` in threads: casting, look-ups, noise and blur all release the interpreter's lock."""
        if self.threads <= 1:
            yield from map(function, items)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            yield from pool.map(function, items)
