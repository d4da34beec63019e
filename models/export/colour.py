"""Grey levels by which viewers show a cloud."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from models.points import PointMap


def grey_levels(points: PointMap) -> npt.NDArray[np.uint8]:
    """Intensity of the valid pixels in row order as 0..255, (n,) uint8; full scale is 255."""
    shown = np.nan_to_num(points.intensity[points.valid])
    return np.rint(np.clip(shown, 0, 1) * 255).astype(np.uint8)
