"""Exported files, read back by programs that did not write them."""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh
from pypcd4 import PointCloud

from models.errors import ExportError
from models.export import SUFFIXES, check_output, write_points
from models.points import Origin, PointMap, Reason


def make_points(shape: tuple[int, int] = (24, 32), share: float = 0.7, seed: int = 0) -> PointMap:
    """A tilted plane with holes, and one valid pixel without a normal."""
    draw = np.random.default_rng(seed)
    valid = draw.random(shape) < share
    v, u = np.mgrid[: shape[0], : shape[1]]
    z = 500 + 0.3 * u - 0.2 * v
    points = np.stack([(u - 16) * z / 1000, (v - 12) * z / 1000, z], axis=-1)
    points[~valid] = np.nan
    normals = np.where(valid[..., None], np.array([0.0, 0.6, -0.8]), np.nan)
    if valid.any():
        normals[tuple(np.argwhere(valid)[0])] = np.nan
    phase = np.where(valid, np.mod(z, 2 * np.pi), np.nan)
    return PointMap(
        points=points.astype(np.float32),
        normals=normals.astype(np.float32),
        confidence=np.where(valid, draw.random(shape), 0).astype(np.float32),
        intensity=draw.random(shape, np.float32),
        modulation=draw.random(shape, np.float32),
        phase_high=phase.astype(np.float32),
        phase_low=phase.astype(np.float32),
        origin=np.where(valid, Origin.LEFT_RIGHT, Origin.NONE).astype(np.uint8),
        mask=np.where(valid, Reason.VALID, Reason.NO_MATCH).astype(np.uint8),
    )


POINTS = make_points()
VALID = POINTS.valid
GREY = np.rint(POINTS.intensity[VALID] * 255)
OUTPUTS = pytest.mark.parametrize("suffix", SUFFIXES)


def test_npz_holds_exactly_the_documented_arrays(tmp_path):
    write_points(POINTS, tmp_path / "cloud.npz")
    with np.load(tmp_path / "cloud.npz", allow_pickle=False) as file:
        arrays = dict(file)
    kinds = {name: (array.dtype, array.shape) for name, array in arrays.items()}
    vector, plane, code = ((np.float32, (24, 32, 3)), (np.float32, (24, 32)), (np.uint8, (24, 32)))
    assert kinds == {
        "points": vector,
        "normals": vector,
        **dict.fromkeys(("confidence", "intensity", "modulation", "phase_high", "phase_low"), plane),
        "origin": code,
        "mask": code,
    }
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, getattr(POINTS, name))


def read_ply(path: Path) -> tuple[list[str], np.ndarray]:
    """Comments and vertices of a binary little-endian PLY, from its own header."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    kinds = {"float": "<f4", "uchar": "u1"}
    fields = [(line.split()[2], kinds[line.split()[1]]) for line in lines if line.startswith("property ")]
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex "))
    vertices = np.frombuffer(body, np.dtype(fields))
    assert len(vertices) == count
    return [line.removeprefix("comment ") for line in lines if line.startswith("comment ")], vertices


def test_ply_holds_the_valid_points_with_their_attributes(tmp_path):
    write_points(POINTS, tmp_path / "cloud.ply")
    comments, vertices = read_ply(tmp_path / "cloud.ply")
    assert comments == ["units: mm", "frame: left camera, x right, y down, z forward"]
    np.testing.assert_array_equal(np.stack([vertices[k] for k in "xyz"], axis=-1), POINTS.points[VALID])
    normals = np.stack([vertices[f"n{k}"] for k in "xyz"], axis=-1)
    np.testing.assert_array_equal(normals[0], 0)
    np.testing.assert_array_equal(normals[1:], POINTS.normals[VALID][1:])
    np.testing.assert_array_equal(vertices["intensity"], POINTS.intensity[VALID])
    np.testing.assert_array_equal(vertices["confidence"], POINTS.confidence[VALID])
    for channel in ("red", "green", "blue"):
        np.testing.assert_array_equal(vertices[channel], GREY)


def test_ply_opens_in_another_program(tmp_path):
    write_points(POINTS, tmp_path / "cloud.ply")
    cloud = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(cloud.vertices, POINTS.points[VALID])
    np.testing.assert_array_equal(cloud.colors[:, 0], GREY)


def test_pcd_is_organised_with_nan_where_invalid(tmp_path):
    write_points(POINTS, tmp_path / "cloud.pcd")
    header = (tmp_path / "cloud.pcd").read_bytes().split(b"DATA")[0].decode("ascii")
    assert "WIDTH 32\nHEIGHT 24\n" in header
    assert "POINTS 768\n" in header
    cloud = PointCloud.from_path(tmp_path / "cloud.pcd")
    assert cloud.fields == ("x", "y", "z", "intensity", "confidence", "normal_x", "normal_y", "normal_z")
    values = cloud.numpy().reshape(24, 32, 8)
    np.testing.assert_array_equal(values[..., :3], POINTS.points)
    np.testing.assert_array_equal(values[..., 3], POINTS.intensity)
    np.testing.assert_array_equal(values[..., 4], POINTS.confidence)
    np.testing.assert_array_equal(values[..., 5:], POINTS.normals)


def test_pcd_rows_are_packed_as_the_header_says(tmp_path):
    write_points(POINTS, tmp_path / "cloud.pcd")
    body = (tmp_path / "cloud.pcd").read_bytes().partition(b"DATA binary\n")[2]
    assert len(body) == 24 * 32 * 8 * 4
    row, column = np.argwhere(VALID)[5]
    record = struct.unpack_from("<8f", body, (row * 32 + column) * 32)
    np.testing.assert_array_equal(np.float32(record[:3]), POINTS.points[row, column])


def test_xyz_is_one_point_a_line(tmp_path):
    write_points(POINTS, tmp_path / "cloud.xyz")
    lines = (tmp_path / "cloud.xyz").read_text().splitlines()
    assert len(lines) == VALID.sum()
    np.testing.assert_allclose(np.loadtxt(lines), POINTS.points[VALID], atol=6e-5)


@pytest.mark.parametrize("suffix", [".tiff", ".tif"])
def test_tiff_is_depth_with_units(tmp_path, suffix):
    write_points(POINTS, tmp_path / f"depth{suffix}")
    with tifffile.TiffFile(tmp_path / f"depth{suffix}") as file:
        (page,) = file.pages
        depth = page.asarray()
        assert "mm" in page.description
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, POINTS.points[..., 2])


def test_glb_is_in_metres_on_the_axes_of_gltf(tmp_path):
    write_points(POINTS, tmp_path / "cloud.glb")
    assert (tmp_path / "cloud.glb").read_bytes()[:4] == b"glTF"
    (cloud,) = trimesh.load(tmp_path / "cloud.glb").geometry.values()
    x, y, z = np.moveaxis(POINTS.points[VALID].astype(float), -1, 0)
    np.testing.assert_allclose(cloud.vertices, np.stack([x, -y, -z], axis=-1) / 1000, rtol=1e-6)
    np.testing.assert_array_equal(cloud.colors, np.stack([GREY, GREY, GREY, 255 + 0 * GREY], axis=-1))


@OUTPUTS
def test_only_the_output_is_left_and_an_old_one_is_replaced(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix.upper()}"
    path.write_bytes(b"old")
    write_points(POINTS, path)
    assert path.stat().st_size > 500
    assert list(tmp_path.iterdir()) == [path]


@OUTPUTS
def test_an_empty_cloud_is_never_a_file(tmp_path, suffix):
    with pytest.raises(ExportError, match="was not written: no pixel has a point"):
        write_points(make_points(share=0), tmp_path / f"cloud{suffix}")
    assert list(tmp_path.iterdir()) == []


@OUTPUTS
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(b"old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ExportError, match=r"cloud.*could not be written: No space left on device"):
        write_points(POINTS, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("cloud.stl", r"suffix '\.stl' is unknown; use one of \.npz, \.ply"),
        ("cloud", "suffix '' is unknown"),
        (".ply", "suffix '' is unknown"),
        ("nowhere/cloud.ply", "nowhere' does not exist"),
        ("folder.ply", "is a folder"),
        ("file.txt/cloud.ply", "does not exist"),
    ],
)
def test_outputs_that_cannot_be_are_refused_before_the_work(tmp_path, name, named):
    (tmp_path / "folder.ply").mkdir()
    (tmp_path / "file.txt").write_text("")
    for refuse in (check_output, lambda path: write_points(POINTS, path)):
        with pytest.raises(ExportError, match=named) as caught:
            refuse(tmp_path / name)
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file.txt", "folder.ply"]


def test_a_folder_without_permission_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # the superuser may write anywhere
    with pytest.raises(ExportError, match="may not be written to"):
        check_output(tmp_path / "cloud.ply")


def test_check_output_touches_nothing(tmp_path):
    check_output(tmp_path / "cloud.PLY")
    assert list(tmp_path.iterdir()) == []


def test_a_full_sensor_is_written_in_seconds(tmp_path):
    points = make_points((480, 640))
    for suffix in SUFFIXES:
        start = time.perf_counter()
        write_points(points, tmp_path / f"cloud{suffix}")
        assert time.perf_counter() - start < 10, suffix
