"""Scenes around a mesh file of the user's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from drivers.simulator.meshes import Mesh
from models.errors import DuofringeError

SUFFIXES = (".stl", ".ply", ".obj", ".off", ".glb")
MOST_FACES = 5_000_000
CREASE_RAD = 0.6
"""Edges sharper than this are shaded as edges, others as part of a curved surface."""


class MeshFileError(DuofringeError):
    """A mesh file is missing, unreadable or has no surface."""


def read_mesh(path: Path | str) -> Mesh:
    """A mesh file, in any unit, centred and scaled into the unit sphere. Raises MeshFileError naming the file."""
    path = Path(path)
    if not path.is_file():
        raise MeshFileError(f"mesh file '{path}' does not exist")
    if path.suffix.lower() not in SUFFIXES:
        raise MeshFileError(f"mesh file '{path}' has an unknown format; known are {', '.join(SUFFIXES)}")
    loaded = _load(path)
    vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces)
    if not len(faces):
        raise MeshFileError(f"mesh file '{path}' has no faces")
    if len(faces) > MOST_FACES:
        raise MeshFileError(f"mesh file '{path}' has {len(faces)} faces; simplify it to {MOST_FACES} or fewer")
    if not np.isfinite(vertices).all() or not np.ptp(vertices, axis=0).max() > 0:
        raise MeshFileError(f"mesh file '{path}' has no extent or coordinates that are not finite")
    shaded = trimesh.graph.smooth_shade(loaded, angle=CREASE_RAD)
    mesh = Mesh(
        np.array(shaded.vertices, np.float64),
        np.array(shaded.faces, np.int32),
        np.array(shaded.vertex_normals, np.float64),
    )
    return mesh.unit()


def _load(path: Path) -> trimesh.Trimesh:
    try:
        loaded = trimesh.load_mesh(path, file_type=path.suffix[1:].lower(), skip_materials=True)
    except Exception as error:  # trimesh's parsers raise whatever a broken file leads them to
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise MeshFileError(f"mesh file '{path}' is not readable ({reason})") from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise MeshFileError(f"mesh file '{path}' holds no triangles")
    return loaded
