"""glTF 2.0, binary: a point cloud for viewers and web pages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from models.export.colour import grey_levels
from models.points import PointMap

_TO_GLTF = np.array([1e-3, -1e-3, -1e-3])
"""Millimetres to metres, and x right, y down, z forward to glTF's x right, y up, z backwards."""


def write_glb(points: PointMap, path: Path) -> None:
    """Valid points in row order with grey colour; metres, glTF's axes."""
    grey = grey_levels(points)
    colours = np.stack([grey, grey, grey, np.full_like(grey, 255)], axis=-1)
    cloud = trimesh.PointCloud(points.points[points.valid] * _TO_GLTF, colors=colours)
    path.write_bytes(cloud.export(file_type="glb"))
