"""Depth edges of a reference, and the pixels near them."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]

STEP = 0.005
"""Least step of an edge as a share of the depth: 2.5 mm at 500 mm, about a pixel of the reference rig's disparity."""
BAND_PX = 5


def depth_edges(depth: npt.NDArray[np.floating], step: float = STEP) -> Mask:
    """Pixels (H, W) on either side of a depth edge of a depth map (H, W), mm, NaN where there is no surface.

    An edge parts two neighbours in a row or a column when one has a depth and the other none, or when their depths
    differ by more than ``step`` of the nearer one, and still do so after the slope of either side is continued across.
    Slopes are those of the inverse depth, which is linear in the image on every plane: no plane has an edge, however
    slanted, and neither has a crease. The border of the image is no edge.
    """
    along_rows = _edges_along_rows(depth, step)
    along_columns = _edges_along_rows(depth.T, step).T
    return along_rows | along_columns


def near_edges(depth: npt.NDArray[np.floating], pixels: float = BAND_PX, step: float = STEP) -> Mask:
    """The band (H, W) of pixels whose centres lie within ``pixels`` of a depth edge, which runs between two pixels."""
    edges = depth_edges(depth, step)
    if not edges.any():
        return edges
    distance = cv2.distanceTransform((~edges).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance + 0.5 <= pixels)


def _edges_along_rows(depth: npt.NDArray[np.floating], step: float) -> Mask:
    depth = depth.astype(np.float64)
    known = np.isfinite(depth)
    inverse = np.divide(1.0, depth, out=np.full(depth.shape, np.nan), where=known & (depth > 0))
    rise = np.diff(inverse, axis=1)
    unknown = np.full((rise.shape[0], 1), np.nan)
    before = np.concatenate([unknown, rise[:, :-1]], axis=1)
    after = np.concatenate([rise[:, 1:], unknown], axis=1)
    # fmin passes over what is unknown: beside a hole the other side's slope decides, or the bare difference.
    jump = np.fmin(np.abs(rise), np.fmin(np.abs(rise - before), np.abs(rise - after)))
    nearest = np.fmax(inverse[:, 1:], inverse[:, :-1])
    parted = (known[:, 1:] != known[:, :-1]) | (np.nan_to_num(jump) > step * np.nan_to_num(nearest))
    edges = np.zeros(depth.shape, np.bool_)
    edges[:, 1:] |= parted
    edges[:, :-1] |= parted
    return edges
