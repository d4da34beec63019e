"""A scene: placed objects with their materials, and perhaps a wall behind them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from drivers.simulator.materials import Material
from drivers.simulator.meshes import Mesh
from drivers.simulator.raycast import Hits, Tracer


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One placed object: its identity, its surface in the left-camera frame (mm), its reflectance."""

    name: str
    mesh: Mesh
    material: Material


@dataclass(frozen=True, eq=False)
class Scene:
    """Objects in front of the rig.

    wall: a background that belongs to no object's identity. traits: what the scene was made to contain
    ("dark", "textured", "glossy", "fine", "wall").
    """

    objects: tuple[SceneObject, ...]
    wall: SceneObject | None = None
    traits: frozenset[str] = field(default_factory=frozenset)

    @property
    def object_id(self) -> str:
        """Identity by which splits are kept disjoint: the names of all objects."""
        return "+".join(o.name for o in self.objects) or "empty"

    @property
    def surfaces(self) -> tuple[SceneObject, ...]:
        """Objects in order, the wall last; ``Hits.objects`` counts in this order."""
        return self.objects if self.wall is None else (*self.objects, self.wall)

    @cached_property
    def tracer(self) -> Tracer:
        return Tracer([s.mesh for s in self.surfaces])

    def albedo_at(self, hits: Hits) -> npt.NDArray[np.float32]:
        """Albedo (N,) of each hit, 0 where there is none."""
        albedo = np.zeros(len(hits.hit), np.float32)
        for index, surface in enumerate(self.surfaces):
            here = np.flatnonzero(hits.objects == index)
            if len(here):
                albedo[here] = surface.material.albedo_at(hits.points[here])
        return albedo
