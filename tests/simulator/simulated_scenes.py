"""Scenes simple enough to be known by hand."""

from __future__ import annotations

import numpy as np

from drivers.simulator.materials import Material
from drivers.simulator.meshes import Mesh
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import cuboid


def slab(depth: float, size: tuple[float, float] = (900.0, 900.0), centre: tuple[float, float] = (0.0, 0.0)) -> Mesh:
    """A plate that faces the rig with its front at z = depth, mm."""
    return cuboid((*size, 2.0), (*centre, depth + 1.0))


def thing(mesh: Mesh, name: str = "thing", **material) -> SceneObject:
    return SceneObject(name, mesh, Material(**material))


def target(albedo: float = 0.8, depth: float = 500.0) -> Scene:
    """The surface of the exposure contract."""
    return Scene((thing(slab(depth), albedo=albedo),))


def box_before_wall() -> Scene:
    """A plate of 80 x 80 mm at 450 mm before a wall at 600 mm."""
    return Scene((thing(slab(450.0, (80.0, 80.0)), "plate"),), thing(slab(600.0), "wall"))


def middle(image: np.ndarray, half: int = 12) -> np.ndarray:
    height, width = image.shape
    return image[height // 2 - half : height // 2 + half, width // 2 - half : width // 2 + half]
