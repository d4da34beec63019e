"""Placing objects in the working volume so that they fill the field without running into one another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.simulator.coverage import CELL_PX, silhouette
from drivers.simulator.meshes import FloatArray, Mesh
from models.geometry.device import Device

_MARGIN_MM = 6.0
_ARRANGEMENTS = 10
_TRIES = 14
_MOST_OBJECTS = 6
_OVERLAP = 0.8
"""Bounding spheres may overlap down to this share of their touching distance: few objects fill theirs."""

Named = tuple[str, Mesh]
Draw = Callable[[int], Named]


@dataclass(frozen=True, eq=False)
class Volume:
    """Where objects may stand: the camera's field between two depths, mm."""

    camera: Device
    near: float
    far: float

    def width_at(self, depth: float) -> float:
        """Width of the field, mm."""
        return self.camera.width / self.camera.fx * depth

    def fit(self, mesh: Mesh, radius: float, pixel: npt.ArrayLike, share: float) -> Mesh:
        """A unit mesh scaled to ``radius`` (less if the volume is too shallow) around a pixel's line of sight.

        share: 0 puts it as near as it may stand, 1 as far.
        """
        low, high = float(mesh.vertices[:, 2].min()), float(mesh.vertices[:, 2].max())
        room = self.far - self.near - 2 * _MARGIN_MM
        radius = min(radius, room / (high - low))
        nearest, farthest = self.near + _MARGIN_MM - radius * low, self.far - _MARGIN_MM - radius * high
        depth = nearest + share * (farthest - nearest)
        return mesh.moved(radius, translation=self.camera.back_project(np.asarray(pixel, np.float64), np.array(depth)))


@dataclass(frozen=True, eq=False)
class _Placed:
    mesh: Mesh
    centre: FloatArray
    radius: float

    @classmethod
    def of(cls, mesh: Mesh) -> _Placed:
        centre = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        return cls(mesh, centre, float(np.linalg.norm(mesh.vertices - centre, axis=1).max()))

    def clashes(self, other: _Placed) -> bool:
        return float(np.linalg.norm(self.centre - other.centre)) < _OVERLAP * (self.radius + other.radius)


def arrange(rng: np.random.Generator, volume: Volume, draw: Draw, least: int, cover: float) -> tuple[Named, ...]:
    """Objects that together cover at least the share ``cover`` of the field, or the best of ten arrangements.

    draw: gives the name and unit mesh, already turned, of a k-th object; called anew in each arrangement.
    least: fewest objects.
    """
    best: tuple[Named, ...] = ()
    best_cover = -1.0
    for attempt in range(_ARRANGEMENTS):
        objects, covered = _one_arrangement(rng, volume, draw, least, cover, swell=1 + 0.06 * attempt)
        share = float(covered.mean())
        if share > best_cover:
            best, best_cover = objects, share
        if best_cover >= cover:
            break
    return best


def _one_arrangement(
    rng: np.random.Generator, volume: Volume, draw: Draw, least: int, cover: float, swell: float
) -> tuple[tuple[Named, ...], npt.NDArray[np.bool_]]:
    camera = volume.camera
    field = swell * volume.width_at((volume.near + volume.far) / 2)
    placed: list[_Placed] = []
    names: list[str] = []
    covered = np.zeros((-(-camera.height // CELL_PX), -(-camera.width // CELL_PX)), np.bool_)
    while len(placed) < _MOST_OBJECTS and (len(placed) < least or covered.mean() < cover):
        main = not placed
        name, unit = draw(len(placed))
        radius = field * (rng.uniform(0.25, 0.34) if main else rng.uniform(0.13, 0.24))
        candidate = _find_place(rng, volume, unit, radius, placed, covered)
        if candidate is None:
            break
        placed.append(candidate)
        names.append(name)
        covered |= silhouette(candidate.mesh, camera)
    return tuple((name, p.mesh) for name, p in zip(names, placed, strict=True)), covered


def _find_place(
    rng: np.random.Generator,
    volume: Volume,
    unit: Mesh,
    radius: float,
    placed: list[_Placed],
    covered: npt.NDArray[np.bool_],
) -> _Placed | None:
    size = np.array(volume.camera.size, np.float64)
    free = np.argwhere(~covered)
    for attempt in range(_TRIES):
        if placed and len(free):
            row, column = free[rng.integers(len(free))]
            pixel = np.array([column + 0.5, row + 0.5]) * CELL_PX
            pixel = np.clip(pixel, 0.1 * size, 0.9 * size)
        else:
            pixel = size * rng.uniform([0.36, 0.38], [0.64, 0.62])
        candidate = _Placed.of(volume.fit(unit, radius * 0.96**attempt, pixel, rng.random()))
        if not any(candidate.clashes(other) for other in placed):
            return candidate
    return None
