"""Depth picture: one float32 channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile

from models.points import PointMap

DESCRIPTION = "depth z in mm along the left camera's axis, left sensor grid, NaN where invalid"


def write_tiff(points: PointMap, path: Path) -> None:
    """Depth (H, W) float32 in mm, NaN where invalid; the units stand in ImageDescription."""
    depth = np.ascontiguousarray(points.depth, np.float32)
    tifffile.imwrite(
        path, depth, photometric="minisblack", description=DESCRIPTION, metadata=None, software="duofringe"
    )
