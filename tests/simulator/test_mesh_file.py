"""Scenes around a user's mesh file."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from drivers.simulator.geometry import reference_rig
from drivers.simulator.mesh_file import MeshFileError, read_mesh
from drivers.simulator.mix import mesh_scene, traits_of


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".off", ".glb"])
def test_every_known_format_is_read_to_unit_size(tmp_path, suffix):
    path = tmp_path / f"part{suffix}"
    trimesh.creation.box((3000.0, 1000.0, 20.0)).export(path)
    mesh = read_mesh(path)
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1)
    extents = np.ptp(mesh.vertices, axis=0)
    assert extents / extents.max() == pytest.approx([1, 1 / 3, 0.02 / 3], abs=1e-6)


def test_creases_stay_sharp_and_curves_smooth(tmp_path):
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    assert np.allclose(np.sort(np.abs(read_mesh(tmp_path / "box.stl").normals), axis=1), [0, 0, 1], atol=1e-6)
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "ball.stl")
    ball = read_mesh(tmp_path / "ball.stl")
    assert np.einsum("ij,ij->i", ball.normals, ball.vertices).min() > 0.999


def test_object_is_scaled_and_placed_in_the_volume(tmp_path):
    trimesh.creation.torus(4.0, 1.0).export(tmp_path / "ring.ply")
    rig, unit = reference_rig(), read_mesh(tmp_path / "ring.ply")
    poses = []
    for index in range(6):
        scene = mesh_scene(1, index, unit, "ring")
        assert scene.object_id == "ring"
        assert scene.traits == traits_of(1, index) - {"fine"}
        (thing,) = scene.objects
        assert thing.mesh.vertices[:, 2].min() > 400
        assert thing.mesh.vertices[:, 2].max() < 670
        pixels = rig.left.project(thing.mesh.vertices)
        assert np.ptp(pixels[:, 0]) > 200
        poses.append(thing.mesh.vertices[0])
    assert len({tuple(np.round(p, 3)) for p in poses}) == 6


def test_bad_mesh_files_are_named_in_one_line(tmp_path):
    files = {
        "missing.stl": (None, "does not exist"),
        "notes.txt": (b"hello", "unknown format"),
        "torn.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\n", "not readable|no triangles|no faces"),
        "noise.stl": (bytes(range(256)) * 3, "not readable|no triangles|no faces"),
        "empty.obj": (b"", "not readable|no triangles|no faces"),
        "points.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "not readable|no triangles|no faces"),
        "flat.obj": (b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "no extent|no faces|no triangles"),
        "nan.obj": (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite|no faces"),
    }
    for name, (content, reason) in files.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(MeshFileError, match=reason) as caught:
            read_mesh(tmp_path / name)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)
