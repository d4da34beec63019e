"""Points from the left camera and the projector alone, where the right camera does not see."""

from __future__ import annotations

import math

import numba
import numpy as np

from models.geometry.projection import project_point

_ITERATIONS = 12
_TOLERANCE = 1e-4
"""Projector columns within which a line of sight counts as solved."""


@numba.njit(cache=True, parallel=True)
def intersect_columns(column, wanted, rays, projector, depth_range):  # type: ignore[no-untyped-def]
    """Left-frame points (H, W, 3), mm float64, where lines of sight meet the plane of light of their projector column.

    column: float32 (H, W). wanted: bool (H, W), pixels to solve. rays: float64 (H, W, 3), left-frame directions with
    z = 1. projector: vector of ``pack_projection``. NaN where the column is not met within ``depth_range`` (mm).
    """
    height, width = column.shape
    points = np.full((height, width, 3), np.nan)
    for i in numba.prange(height):
        for k in range(width):
            if not wanted[i, k]:
                continue
            a, b = rays[i, k, 0], rays[i, k, 1]
            # The column is nearly linear in inverse depth, so false position settles in a few steps.
            near, far = 1.0 / depth_range[0], 1.0 / depth_range[1]
            at_near = project_point(projector, a / near, b / near, 1.0 / near)[0] - column[i, k]
            at_far = project_point(projector, a / far, b / far, 1.0 / far)[0] - column[i, k]
            if not at_near * at_far < 0:
                continue
            for _ in range(_ITERATIONS):
                inverse = near - at_near * (far - near) / (at_far - at_near)
                here = project_point(projector, a / inverse, b / inverse, 1.0 / inverse)[0] - column[i, k]
                if math.fabs(here) < _TOLERANCE:
                    points[i, k, 0], points[i, k, 1], points[i, k, 2] = a / inverse, b / inverse, 1.0 / inverse
                    break
                if here * at_near < 0:
                    far, at_far = inverse, here
                else:
                    near, at_near = inverse, here
    return points
