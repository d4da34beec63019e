"""Point cloud data (PCL, version 0.7): the organised map, binary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pypcd4 import Encoding, PointCloud

from models.points import PointMap

_FIELDS = ("x", "y", "z", "intensity", "confidence", "normal_x", "normal_y", "normal_z")


def write_pcd(points: PointMap, path: Path) -> None:
    """All pixels in row order (WIDTH x HEIGHT of the left sensor), NaN where invalid; mm, left-camera frame."""
    height, width = points.shape
    layers = [points.points, points.intensity[..., None], points.confidence[..., None], points.normals]
    values = np.concatenate(layers, axis=-1).reshape(height * width, len(_FIELDS))
    cloud = PointCloud.from_points(values, _FIELDS, (np.float32,) * len(_FIELDS))
    cloud.metadata.width, cloud.metadata.height = width, height
    cloud.save(path, Encoding.BINARY)
