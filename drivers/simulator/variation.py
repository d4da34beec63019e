"""Rigs, light and surfaces that differ from sample to sample, so that what is learned from them holds elsewhere.

Everything is drawn around the reference rig: devices are placed, focused and aimed anew, lenses and lamp are
better or worse, the projector's response is not quite linear, things are glossier and more finely textured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.simulator.geometry import CAMERA_SIZE, RASTER_SIZE, WORKING_RANGE_MM, placed
from drivers.simulator.lamp import Levels
from drivers.simulator.materials import TEXTURES, Material
from drivers.simulator.optics import Optics
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.sensor import REFERENCE_EXPOSURE_US, Sensor
from models.geometry.device import Device
from models.geometry.rig import Rig
from models.patterns import Raster, RasterKind

_RIG_STREAM, _SURFACE_STREAM = 21, 22
_REFERENCE_DISTANCE_MM = 500.0
_WILD_SHARE = 0.45
_BOUNCE_SHARE = 0.3


def varied_rig(seed: int, index: int) -> SimulatedRig:
    """The rig of sample ``index`` of the series ``seed``; depends on nothing else."""
    rng = np.random.default_rng([seed, index, _RIG_STREAM])
    return SimulatedRig(
        rig=_geometry(rng),
        optics=Optics(
            psf_px=rng.uniform(0.3, 0.8),
            defocus_columns=float(np.exp(rng.uniform(np.log(0.45), np.log(1.6)))),
            contrast=float(np.exp(rng.uniform(np.log(150), np.log(1200)))),
            gamma=float(np.exp(rng.normal(0, 0.12))) if rng.random() < 0.6 else 1.0,
        ),
        sensor=Sensor(
            exposure_us=REFERENCE_EXPOSURE_US * rng.uniform(0.45, 1.3),
            gain_db=rng.uniform(0, 5) if rng.random() < 0.5 else 0.0,
            bit_depth=12 if rng.random() < 0.25 else 8,
            full_well=float(np.exp(rng.uniform(np.log(4_000), np.log(25_000)))),
            read_noise=rng.uniform(3, 20),
            black_level=rng.uniform(0, 3),
        ),
        levels=Levels(off=rng.uniform(3, 25)),
        interreflection=bool(rng.random() < _BOUNCE_SHARE),
    )


def varied_surfaces(scene: Scene, seed: int, index: int) -> Scene:
    """The same things with other surfaces: nearly half of them with any texture, shine and brightness."""
    rng = np.random.default_rng([seed, index, _SURFACE_STREAM])

    def with_surface(thing: SceneObject) -> SceneObject:
        chosen = _wild_material(rng, thing.material)
        return replace(thing, material=chosen) if rng.random() < _WILD_SHARE else thing

    objects = tuple(with_surface(thing) for thing in scene.objects)
    return replace(scene, objects=objects, wall=None if scene.wall is None else with_surface(scene.wall))


def _wild_material(rng: np.random.Generator, usual: Material) -> Material:
    return Material(
        albedo=min(usual.albedo * rng.uniform(0.5, 1.4), 0.9),
        texture=TEXTURES[rng.integers(len(TEXTURES))],
        contrast=rng.uniform(0.2, 0.92),
        scale_mm=float(np.exp(rng.uniform(np.log(3.0), np.log(40.0)))),
        seed=usual.seed,
        specular=rng.uniform(0.01, 0.12) if rng.random() < 0.5 else 0.0,
        shininess=rng.uniform(10, 150),
    )


def _geometry(rng: np.random.Generator) -> Rig:
    distance = rng.uniform(430, 580)
    scale = distance / _REFERENCE_DISTANCE_MM
    meeting = (0.0, 0.0, distance)
    kind: RasterKind = "diamond" if rng.random() < 0.7 else "square"
    columns, rows = RASTER_SIZE
    fx = columns * distance / (rng.uniform(340, 480) * scale)
    fy = 2 * fx if kind == "diamond" else fx
    lens_shift = rng.uniform(0, 1) if rng.random() < 0.4 else 0.0
    middle_row = (rows - 1) / 2
    principal = np.array([[fx, 0, (columns - 1) / 2], [0, fy, middle_row + lens_shift * rows / 2], [0, 0, 1]])
    aim = np.array([0.0, -lens_shift * rows / 2 / fy, 1.0])
    side = -1.0 if rng.random() < 0.25 else 1.0
    projector = placed(
        RASTER_SIZE,
        principal,
        _distortion(rng, (-0.06, 0.02)),
        (rng.uniform(-20, 140), -side * rng.uniform(20, 100), rng.uniform(-30, 30)),
        "projector",
        aim,
        meeting,
    )
    right_centre = (rng.uniform(80, 170), rng.uniform(-6, 6), rng.uniform(-6, 6))
    matrix = _camera_matrix(rng)
    left = Device(CAMERA_SIZE, matrix, _distortion(rng, (-0.2, 0.05)), name="left")
    right = placed(
        CAMERA_SIZE,
        matrix + np.array([[rng.uniform(-9, 9), 0, rng.uniform(-6, 6)], [0, rng.uniform(-9, 9), 0], [0, 0, 0]]),
        _distortion(rng, (-0.2, 0.05)),
        right_centre,
        "right",
        None,
        meeting,
    )
    near, far = (round(limit * scale, 1) for limit in WORKING_RANGE_MM)
    quality = {"source": "simulated rig, varied geometry", "working_range_mm": [near, far]}
    return Rig(left, right, projector, Raster(columns, rows, kind), quality)


def _camera_matrix(rng: np.random.Generator) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    focal = rng.uniform(880, 1180)
    width, height = CAMERA_SIZE
    across, down = (width - 1) / 2 + rng.uniform(-12, 12), (height - 1) / 2 + rng.uniform(-12, 12)
    return np.array([[focal, 0, across], [0, focal * rng.uniform(0.995, 1.005), down], [0, 0, 1]])


def _distortion(
    rng: np.random.Generator, radial: tuple[float, float]
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([rng.uniform(*radial), rng.uniform(-0.03, 0.03), *rng.uniform(-4e-4, 4e-4, 2), 0.0])
