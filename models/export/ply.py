"""Polygon file format (G. Turk, 1994): valid points with normals, confidence and grey colour, binary."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.export.colour import grey_levels
from models.points import PointMap

_FIELDS = [
    *((name, "<f4", "float") for name in ("x", "y", "z", "nx", "ny", "nz")),
    *((name, "u1", "uchar") for name in ("red", "green", "blue")),
    *((name, "<f4", "float") for name in ("intensity", "confidence")),
]


def write_ply(points: PointMap, path: Path) -> None:
    """One vertex a valid pixel in row order; mm, left-camera frame. An unknown normal is (0, 0, 0)."""
    valid = points.valid
    vertices = np.empty(len(points), np.dtype([(name, kind) for name, kind, _ in _FIELDS]))
    for names, array in ((("x", "y", "z"), points.points), (("nx", "ny", "nz"), np.nan_to_num(points.normals))):
        for axis, name in enumerate(names):
            vertices[name] = array[..., axis][valid]
    for name in ("red", "green", "blue"):
        vertices[name] = grey_levels(points)
    vertices["intensity"] = points.intensity[valid]
    vertices["confidence"] = points.confidence[valid]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment units: mm",
        "comment frame: left camera, x right, y down, z forward",
        f"element vertex {len(vertices)}",
        *(f"property {kind} {name}" for name, _, kind in _FIELDS),
        "end_header",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
