"""Procedural shapes. Each is a function of a random generator and gives a mesh inside the unit sphere.

Frames: shapes with a face (stairs, reliefs, waves, combs, grilles) show it to -z, where the cameras are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import trimesh

from drivers.simulator.meshes import FloatArray, IndexArray, Mesh
from drivers.simulator.noise import fractal_noise

Shape = Callable[[np.random.Generator], Mesh]
_ICOSPHERE_SUBDIVISIONS = 6
_SEGMENTS = 96
_SIDE_SHARES = np.linspace(0, 1, 9)[:, None, None]
"""Rows of faces across sides and ends: long thin triangles that lie aslant make ray casting several times slower."""


def grid_faces(rows: int, columns: int) -> IndexArray:
    """Two triangles a cell of a (rows, columns) grid of vertices."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:])
    lower, upper = np.stack([a, c, b], -1), np.stack([b, c, d], -1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.int32)


def patch(points: FloatArray, *, round_rows: bool = False, round_columns: bool = False) -> Mesh:
    """A smooth surface through a grid of points (rows, columns, 3).

    round_rows, round_columns: the last row (column) closes up with the first without an edge.
    """
    vertices, faces = points.reshape(-1, 3), grid_faces(points.shape[0], points.shape[1])
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    mesh = Mesh.smooth(vertices, faces[area > 0])
    normals = mesh.normals.reshape(points.shape).copy()
    for is_round, grid in ((round_rows, normals), (round_columns, normals.swapaxes(0, 1))):
        if is_round:
            seam = grid[0] + grid[-1]
            grid[0] = grid[-1] = seam / np.linalg.norm(seam, axis=-1, keepdims=True)
    return Mesh(mesh.vertices, mesh.faces, normals.reshape(-1, 3))


def quad(corner: tuple[float, ...], along: tuple[float, ...], across: tuple[float, ...]) -> Mesh:
    """A flat parallelogram from a corner and its two edges."""
    p, a, b = np.array(corner, np.float64), np.array(along, np.float64), np.array(across, np.float64)
    return patch(np.stack([np.stack([p, p + b]), np.stack([p + a, p + a + b])]))


def cuboid(size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """An axis-parallel box with sharp edges."""
    (w, h, d), low = size, tuple(c - s / 2 for c, s in zip(centre, size, strict=True))
    x, y, z = low
    return Mesh.join(
        [
            quad((x, y, z), (w, 0, 0), (0, h, 0)),
            quad((x, y, z + d), (w, 0, 0), (0, h, 0)),
            quad((x, y, z), (w, 0, 0), (0, 0, d)),
            quad((x, y + h, z), (w, 0, 0), (0, 0, d)),
            quad((x, y, z), (0, h, 0), (0, 0, d)),
            quad((x + w, y, z), (0, h, 0), (0, 0, d)),
        ]
    )


def rod(radius: float, length: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A cylinder along y with flat ends."""
    rings = int(np.clip(np.ceil(length / radius * 4), 4, 60))
    angle = np.linspace(0, 2 * np.pi, _SEGMENTS + 1)
    circle = radius * np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], -1)
    heights = np.array([[0.0, y, 0.0] for y in np.linspace(-length / 2, length / 2, rings + 1)])
    sides = heights[:, None] + circle
    return Mesh.join(
        [patch(sides, round_columns=True), *(patch(heights[end] + _SIDE_SHARES * circle) for end in (0, -1))]
    ).moved(translation=centre)


@lru_cache(maxsize=1)
def unit_sphere() -> tuple[FloatArray, IndexArray]:
    """Vertices (V, 3) and faces (F, 3) of a finely and evenly divided sphere of radius 1."""
    ball = trimesh.creation.icosphere(subdivisions=_ICOSPHERE_SUBDIVISIONS)
    return np.array(ball.vertices, np.float64), np.array(ball.faces, np.int32)


def sphere(rng: np.random.Generator) -> Mesh:
    """A sphere or a mild ellipsoid."""
    vertices, faces = unit_sphere()
    axes = np.ones(3) if rng.random() < 0.5 else rng.uniform(0.65, 1.0, 3)
    return Mesh.smooth(vertices * axes, faces).unit()


def box(rng: np.random.Generator) -> Mesh:
    width, height, depth = rng.uniform(0.5, 1.0, 3)
    return cuboid((width, height, depth)).unit()


def cylinder(rng: np.random.Generator) -> Mesh:
    return rod(0.5, float(rng.uniform(0.7, 2.2))).unit()


def torus(rng: np.random.Generator) -> Mesh:
    tube = rng.uniform(0.3, 0.5)
    around, about = np.meshgrid(np.linspace(0, 2 * np.pi, 257), np.linspace(0, 2 * np.pi, 129), indexing="ij")
    distance = 1 + tube * np.cos(about)
    ring = np.stack([distance * np.cos(around), distance * np.sin(around), tube * np.sin(about)], -1)
    return patch(ring, round_rows=True, round_columns=True).unit()


def blob(rng: np.random.Generator) -> Mesh:
    """A sphere deformed by noise, from a pebble to a lumpy figure."""
    vertices, faces = unit_sphere()
    seed, depth, frequency = int(rng.integers(2**31)), rng.uniform(0.35, 0.8), rng.uniform(0.7, 1.35)
    offset = rng.uniform(-10, 10, 3)
    swell = fractal_noise(vertices * frequency + offset, seed, octaves=3, gain=0.28)
    return Mesh.smooth(vertices * np.exp(depth * swell)[:, None] * rng.uniform(0.75, 1.0, 3), faces).unit()


def _height_field(x: FloatArray, y: FloatArray, height: FloatArray, thickness: float) -> Mesh:
    """A block whose front (towards -z) is z = -height; its sides go back by ``thickness``."""
    front = np.stack([x, y, -height], -1)
    parts = [patch(front)]
    for edge in (front[0], front[-1], front[:, 0], front[:, -1]):
        back = edge.copy()
        back[:, 2] = thickness
        parts.append(patch(edge + _SIDE_SHARES * (back - edge)))
    return Mesh.join(parts)


def _plate_grid(rng: np.random.Generator, steps: int = 180) -> tuple[FloatArray, FloatArray]:
    aspect = rng.uniform(0.7, 1.0)
    y, x = np.meshgrid(np.linspace(-aspect, aspect, steps), np.linspace(-1, 1, steps), indexing="ij")
    return x, y


def wave(rng: np.random.Generator) -> Mesh:
    """A block with a wavy front: one or two sine waves in any direction."""
    x, y = _plate_grid(rng)
    height = np.zeros_like(x)
    for amplitude in (rng.uniform(0.06, 0.13), rng.uniform(0.0, 0.06)):
        direction, waves = rng.uniform(0, np.pi), rng.uniform(1.2, 3.2)
        height += amplitude * np.sin(
            np.pi * waves * (x * np.cos(direction) + y * np.sin(direction)) + rng.uniform(0, 6)
        )
    return _height_field(x, y, height, 0.35).unit()


def relief(rng: np.random.Generator) -> Mesh:
    """A block with a Perlin landscape for a front."""
    x, y = _plate_grid(rng, 220)
    seed, frequency = int(rng.integers(2**31)), rng.uniform(1.0, 2.0)
    points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3) * frequency + rng.uniform(-10, 10, 3)
    height = rng.uniform(0.25, 0.5) * fractal_noise(points, seed, octaves=3, gain=0.38).reshape(x.shape)
    return _height_field(x, y, height, 0.4).unit()


def plane(rng: np.random.Generator) -> Mesh:
    """A flat plate, thin in z."""
    return cuboid((float(rng.uniform(1.4, 2.0)), float(rng.uniform(1.1, 1.8)), 0.06)).unit()


def stairs(rng: np.random.Generator) -> Mesh:
    """A flight of 4 to 8 steps rising to the back, as wide as it is long; every edge is sharp."""
    count = int(rng.integers(4, 9))
    run, rise = 2.0 / count, rng.uniform(0.9, 1.8) / count
    width = rng.uniform(1.4, 2.2)
    steps = [
        # y points down, so that a higher step has a smaller y
        cuboid((width, (i + 1) * rise, run), (0.0, -(i + 1) * rise / 2, i * run))
        for i in range(count)
    ]
    return Mesh.join(steps).unit()


def terraces(rng: np.random.Generator) -> Mesh:
    """Concentric square steps towards the viewer, a stepped pyramid."""
    count = int(rng.integers(3, 7))
    rise = rng.uniform(0.5, 1.0) / count
    aspect = rng.uniform(0.75, 1.0)
    layers = []
    for i in range(count):
        side = 2.0 * (1 - i / (count + 0.5))
        layers.append(cuboid((side, side * aspect, rise), (0.0, 0.0, -i * rise)))
    return Mesh.join(layers).unit()


def comb(rng: np.random.Generator) -> Mesh:
    """Thin upright fins on a base plate."""
    count = int(rng.integers(4, 8))
    depth, thickness = rng.uniform(0.25, 0.5), rng.uniform(0.03, 0.07)
    fins = [cuboid((thickness, 1.5, depth), (x, 0.0, -depth / 2)) for x in np.linspace(-0.9, 0.9, count)]
    return Mesh.join([cuboid((2.0, 1.6, 0.1)), *fins]).unit()


def grille(rng: np.random.Generator) -> Mesh:
    """A frame with thin round bars in it."""
    count, radius = int(rng.integers(5, 9)), rng.uniform(0.025, 0.05)
    bars = [rod(radius, 1.6, (x, 0.0, 0.0)) for x in np.linspace(-0.85, 0.85, count)]
    frame = [cuboid((2.0, 0.18, 0.18), (0.0, y, 0.0)) for y in (-0.8, 0.8)]
    return Mesh.join([*bars, *frame]).unit()


SMOOTH: dict[str, Shape] = {"sphere": sphere, "cylinder": cylinder, "torus": torus, "blob": blob}
FACED: dict[str, Shape] = {"wave": wave, "relief": relief, "plane": plane}
FINE: dict[str, Shape] = {"stairs": stairs, "terraces": terraces, "comb": comb, "grille": grille}
SHAPES: dict[str, Shape] = {**SMOOTH, "box": box, **FACED, **FINE}
"""Every procedural shape by the name that object ids use."""
