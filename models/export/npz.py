"""Every array of a point map, for numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.points import PointMap

ARRAYS = (
    "points",
    "normals",
    "confidence",
    "intensity",
    "modulation",
    "phase_high",
    "phase_low",
    "origin",
    "mask",
)


def write_npz(points: PointMap, path: Path) -> None:
    """Compressed arrays on the left sensor's grid, named and typed as in ``PointMap``; mm, rad."""
    with path.open("wb") as file:  # by name, numpy would add a suffix that it does not know
        np.savez_compressed(file, **{name: getattr(points, name) for name in ARRAYS})
