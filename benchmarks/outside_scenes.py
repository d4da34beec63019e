"""Scenes unlike any that the refiner learned from: ``python -m benchmarks.outside_scenes FOLDER``.

Mesh files of shapes that the simulator's own mix does not have, written first and read as a user's would be; strong
textures, gloss, and one diffuse bounce of light between surfaces, before the reference rig. Evaluate them with
``duofringe evaluate FOLDER --split all``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh

from drivers.simulator.dataset import sample_id
from drivers.simulator.materials import TEXTURES, Material
from drivers.simulator.mesh_file import read_mesh
from drivers.simulator.meshes import FloatArray
from drivers.simulator.mix import mesh_scene
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from drivers.simulator.shapes import grid_faces
from models.atomic import atomic_folder
from models.capture import write_capture
from models.dataset import SAMPLES_NAME
from models.patterns import make_plan

SEED = 20261122
_STREAM = 91
_RING, _TUBE = 720, 96


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.outside_scenes", description=__doc__)
    arguments.add_argument("folder", type=Path, help="new dataset folder")
    arguments.add_argument("--samples", type=int, default=24, help="number of scenes (default 24)")
    arguments.add_argument("--seed", type=int, default=SEED, help=f"of the scenes (default {SEED})")
    options = arguments.parse_args()
    rig, plan = SimulatedRig(interreflection=True), make_plan("full")
    with tempfile.TemporaryDirectory() as temporary, atomic_folder(options.folder) as partial:
        meshes = write_meshes(Path(temporary))
        (partial / SAMPLES_NAME).mkdir()
        for index in range(options.samples):
            path = meshes[index % len(meshes)]
            plain = mesh_scene(options.seed, index, read_mesh(path), f"{path.stem}-{index}", rig.rig)
            capture = rig.render(dressed(plain, options.seed, index), plan, (options.seed, index))
            named = replace(capture, record=capture.record.model_copy(update={"id": sample_id(index)}))
            write_capture(named, partial / SAMPLES_NAME / sample_id(index))
            print(f"{index + 1} of {options.samples}: {path.stem}", flush=True)


def dressed(scene: Scene, seed: int, index: int) -> Scene:
    """The scene with stronger textures and more gloss than the default mix ever has."""
    rng = np.random.default_rng([seed, index, _STREAM])

    def material(usual: Material) -> Material:
        return Material(
            albedo=float(np.clip(usual.albedo * rng.uniform(0.7, 1.2), 0.25, 0.75)),
            texture=TEXTURES[rng.integers(len(TEXTURES))],
            contrast=rng.uniform(0.6, 0.85),
            scale_mm=float(np.exp(rng.uniform(np.log(5.0), np.log(25.0)))),
            seed=usual.seed,
            specular=rng.uniform(0.03, 0.08) if index % 2 else 0.0,
            shininess=rng.uniform(20, 120),
        )

    objects = tuple(replace(thing, material=material(thing.material)) for thing in scene.objects)
    traits = {"textured", *(("glossy",) if index % 2 else ()), *(("wall",) if scene.wall else ())}
    return replace(scene, objects=objects, traits=frozenset(traits))


def write_meshes(folder: Path) -> list[Path]:
    """One STL file of each shape."""
    paths = []
    for name, make in SHAPES.items():
        paths.append(folder / f"{name}.stl")
        make().export(paths[-1])
    return paths


def knot() -> trimesh.Trimesh:
    """A tube along a (2, 3) torus knot."""
    t = np.linspace(0, 2 * np.pi, _RING, endpoint=False)
    radius = 2 + np.cos(3 * t)
    return tube(np.stack([radius * np.cos(2 * t), radius * np.sin(2 * t), 1.2 * np.sin(3 * t)], -1), 0.55)


def spring() -> trimesh.Trimesh:
    """A helix of round wire."""
    t = np.linspace(0, 8 * np.pi, _RING)
    return tube(np.stack([np.cos(t), np.sin(t), 0.14 * t], -1), 0.22)


def tube(line: FloatArray, radius: float) -> trimesh.Trimesh:
    """Round tube along points (n, 3); its ends, where they do not meet, stay open."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    angle = np.linspace(0, 2 * np.pi, _TUBE)[:, None, None]
    points = line + radius * (np.cos(angle) * side + np.sin(angle) * up)
    if np.linalg.norm(line[0] - line[-1]) < 0.1:
        points = np.concatenate([points, points[:, :1]], axis=1)
    return surface(points)


def vase() -> trimesh.Trimesh:
    """A fluted solid of revolution."""
    height, angle = np.meshgrid(np.linspace(-1, 1, 300), np.linspace(0, 2 * np.pi, 400), indexing="ij")
    radius = (0.5 + 0.22 * np.sin(3.2 * height + 0.6)) * (1 + 0.06 * np.cos(12 * angle + 3 * height))
    return surface(np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], -1))


def column() -> trimesh.Trimesh:
    """A square column twisted by a third of a turn, sharp along its edges."""
    height = np.linspace(-1, 1, 200)
    corners = 0.55 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]], np.float64)
    sides = []
    for first, second in pairwise(corners):
        share = np.linspace(0, 1, 60)[:, None]
        edge = first + share * (second - first)
        turn = (np.pi / 3 * height)[:, None]
        x = np.cos(turn) * edge[:, 0] - np.sin(turn) * edge[:, 1]
        z = np.sin(turn) * edge[:, 0] + np.cos(turn) * edge[:, 1]
        sides.append(surface(np.stack([x, np.broadcast_to(height[:, None], x.shape), z], -1)))
    return trimesh.util.concatenate(sides)


def saddle() -> trimesh.Trimesh:
    """A monkey saddle with ripples."""
    y, x = np.mgrid[-1:1:220j, -1:1:220j]
    z = 0.45 * (x**3 - 3 * x * y**2) + 0.03 * np.cos(16 * np.hypot(x, y))
    front, back = (surface(np.stack([x, y, z + offset], -1)) for offset in (-0.02, 0.02))
    if front.face_normals[:, 2].mean() > 0:
        front.invert()
    if back.face_normals[:, 2].mean() < 0:
        back.invert()
    return trimesh.util.concatenate([front, back])


def gear() -> trimesh.Trimesh:
    """A bevelled gear wheel: flat faces, steps and slots."""
    angle = np.linspace(0, 2 * np.pi, 721)
    teeth = 0.85 + 0.13 * np.clip(3 * np.cos(14 * angle), -1, 1)
    rings = [(0.3, 0.2), (0.3, -0.2), (0.55, -0.2), (0.55, -0.12), (0.8, -0.12), (1.0, -0.06), (1.0, 0.2), (0.3, 0.2)]
    line = []
    for (r0, z0), (r1, z1) in pairwise(rings):
        share = np.linspace(0, 1, 24)
        line += [(r0 + s * (r1 - r0), z0 + s * (z1 - z0)) for s in share]
    profile = np.array(line)[:, None, :]
    radius = np.where(profile[..., 0] > 0.79, profile[..., 0] * teeth, profile[..., 0] * np.ones_like(teeth))
    return surface(np.stack([radius * np.cos(angle), radius * np.sin(angle), profile[..., 1] + 0 * radius], -1))


def surface(points: FloatArray) -> trimesh.Trimesh:
    """Triangles through a grid of points (rows, columns, 3), facing away from the origin."""
    made = trimesh.Trimesh(points.reshape(-1, 3), grid_faces(points.shape[0], points.shape[1]), process=False)
    if made.volume < 0:
        made.invert()
    return made


SHAPES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "knot": knot,
    "spring": spring,
    "vase": vase,
    "column": column,
    "saddle": saddle,
    "gear": gear,
}


if __name__ == "__main__":
    main()
