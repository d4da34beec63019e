"""The middle of the reference rig's cameras: cheap to simulate and to reconstruct, with fringes as fine as ever."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from drivers.simulator.devices import SimulatedSource
from drivers.simulator.geometry import reference_rig
from drivers.simulator.materials import Material
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import cuboid
from models.capture import Capture
from models.geometry.device import Device
from models.patterns import make_plan

WIDTH, HEIGHT = 192, 96
DEPTH_RANGE = (400.0, 670.0)


def _middle(camera: Device) -> Device:
    """The same camera reading a window in the middle of its sensor."""
    width, height = camera.size
    matrix = camera.matrix.copy()
    matrix[0, 2] -= (width - WIDTH) // 2
    matrix[1, 2] -= (height - HEIGHT) // 2
    return replace(camera, size=(WIDTH, HEIGHT), matrix=matrix)


@lru_cache(maxsize=1)
def small_rig() -> SimulatedRig:
    rig = reference_rig()
    return SimulatedRig(replace(rig, left=_middle(rig.left), right=_middle(rig.right)), threads=1)


@lru_cache(maxsize=2)
def plate(seed: int = 5) -> Capture:
    """A plate before a wall, full plan; nobody may write into it."""
    front = SceneObject("plate", cuboid((150.0, 110.0, 2.0), (20.0, 10.0, 461.0)), Material(albedo=0.5))
    wall = SceneObject("wall", cuboid((900.0, 900.0, 2.0), (0.0, 0.0, 601.0)), Material(albedo=0.5))
    return small_rig().render(Scene((front,), wall), make_plan("full"), seed)


def simulated_source() -> SimulatedSource:
    """A fresh simulation before the small rig."""
    return SimulatedSource(seed=1, scene=3, rig=small_rig())
