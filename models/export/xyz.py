"""Plain text: one ``x y z`` a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.points import PointMap


def write_xyz(points: PointMap, path: Path) -> None:
    """Valid points in row order, mm to 0.1 micrometre, left-camera frame."""
    np.savetxt(path, points.points[points.valid], fmt="%.4f")
