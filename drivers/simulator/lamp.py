"""The projector as a light source: how much of it falls on a surface, and which mirror it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from drivers.simulator.optics import project_points
from drivers.simulator.raycast import Hits, Tracer
from models.geometry.device import Device

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
REFERENCE_ALBEDO = 0.8


@dataclass(frozen=True)
class Levels:
    """Light levels, given as the 8-bit reading of a surface of albedo 0.8 that faces the rig, on the left axis.

    white: reading under full white at the default exposure. off: reading with the projector off, the sensor's black
    level included. distance_mm: how far that surface stands from the left camera.
    """

    white: float = 220.0
    off: float = 4.0
    distance_mm: float = 500.0

    def lamp_scale(self, left: Device, projector: Device) -> float:
        """Sensor light (1 = white level) per unit radiance under a projector of unit radiant intensity (1/mm^2)."""
        target = left.back_project(left.matrix[:2, 2], self.distance_mm)
        towards = projector.centre - target
        distance = float(np.linalg.norm(towards))
        irradiance = -float(towards[2]) / distance**3
        return (self.white - self.off) / 255 * np.pi / (REFERENCE_ALBEDO * irradiance)

    def ambient_scale(self, black_level: float) -> float:
        """Sensor light per unit of albedo under the ambient light."""
        return (self.off - black_level) / 255 / REFERENCE_ALBEDO


@dataclass(frozen=True, eq=False)
class Irradiance:
    """Projector light on N surface points, as sensor light per unit of BRDF.

    strength: float32 (N,), under full white, 0 where no light comes. mirrors: float32 (N, 2), projector coordinates
    (u, v), NaN behind the projector. lit: bool (N,), inside the raster, facing the projector and not shadowed.
    """

    strength: Float32Array
    mirrors: Float32Array
    lit: BoolArray


@dataclass(frozen=True, eq=False)
class Lamp:
    """device: the projector. scale: see ``Levels.lamp_scale``."""

    device: Device
    scale: float

    def falling_on(self, hits: Hits, tracer: Tracer) -> Irradiance:
        """Cosine and inverse-square fall-off, the raster's edge, and shadow rays."""
        mirrors = project_points(self.device, hits.points)
        strength = np.zeros(len(hits.hit), np.float32)
        width, height = self.device.size
        _fall_off(
            hits.hit,
            hits.points,
            hits.normals,
            hits.facets,
            mirrors,
            self.device.centre,
            self.scale,
            width - 0.5,
            height - 0.5,
            strength,
        )
        reached = np.flatnonzero(strength > 0)
        shadowed = ~tracer.sees(hits.lifted_at(reached), self.device.centre)
        strength[reached[shadowed]] = 0
        return Irradiance(strength, mirrors, strength > 0)


@compiled
def _fall_off(
    hit: Any, points: Any, normals: Any, facets: Any, mirrors: Any, centre: Any, scale: float, right: float,
    bottom: float, strength: Any,
) -> None:  # fmt: skip
    for i in range(len(hit)):
        u, v = mirrors[i, 0], mirrors[i, 1]
        if not (hit[i] and u >= -0.5 and u <= right and v >= -0.5 and v <= bottom):
            continue
        square = 0.0
        along_normal = 0.0
        along_facet = 0.0
        for k in range(3):
            towards = centre[k] - points[i, k]
            square += towards * towards
            along_normal += towards * normals[i, k]
            along_facet += towards * facets[i, k]
        if along_normal > 0 and along_facet > 0:
            strength[i] = scale * along_normal / (square * np.sqrt(square))
