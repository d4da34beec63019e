"""Reference matching: the point on the right row with the same absolute projector column.

A column may stand twice on a row, on an object and on what lies behind it, lit through different rows of the
projector. Only one of the two points projects back to that column.
"""

from __future__ import annotations

import numba
import numpy as np

from models.geometry.projection import project_point
from models.points import Reason
from models.stereo.search import search_interval

_VALID, _NO_MATCH, _AMBIGUOUS = int(Reason.VALID), int(Reason.NO_MATCH), int(Reason.AMBIGUOUS)
_STEEPEST = 4.2
"""Projector columns per canvas pixel; a steeper step between right pixels is an edge."""


@numba.njit(cache=True, parallel=True)
def match_columns(  # type: ignore[no-untyped-def]
    column_l, column_r, usable_l, usable_r, frame, turn, depth_range, projector, direction=1.0
):
    """Right canvas column for every left canvas pixel, and the reason where there is none.

    column_l, column_r: float32 (h, w) projector columns. frame, turn, depth_range, projector and direction as in
    ``find_candidates``. Returns x_right float32 (h, w), NaN where unmatched, and reason uint8 (h, w): NO_MATCH, or
    AMBIGUOUS where two crossings lie more than a pixel apart and no projector tells them apart.
    """
    height, width = column_l.shape
    right_width = column_r.shape[1]
    focal, baseline, cx_l, cx_r, cy, row_step = frame
    x_right = np.full((height, width), np.nan, np.float32)
    reason = np.full((height, width), _NO_MATCH, np.uint8)
    for y in numba.prange(height):
        down = (y * row_step - cy) / focal
        for x in range(width):
            if not usable_l[y, x]:
                continue
            across, _, _, start, stop = search_interval(x, down, frame, turn, depth_range, right_width)
            u = column_l[y, x]
            found = -1.0
            closest = np.inf
            clash = False
            for j in range(start, stop + 1):
                if not (usable_r[y, j] and usable_r[y, j + 1]):
                    continue
                behind = direction * (column_r[y, j] - u)
                ahead = direction * (column_r[y, j + 1] - u)
                if behind > 0 or ahead <= 0 or ahead - behind > _STEEPEST:
                    continue
                right = j - behind / (ahead - behind)
                if projector.size > 0:
                    zr = focal * baseline / (x - cx_l - right + cx_r)
                    xr, yr = across * zr, down * zr
                    px = turn[0, 0] * xr + turn[0, 1] * yr + turn[0, 2] * zr
                    py = turn[1, 0] * xr + turn[1, 1] * yr + turn[1, 2] * zr
                    pz = turn[2, 0] * xr + turn[2, 1] * yr + turn[2, 2] * zr
                    away = abs(project_point(projector, px, py, pz)[0] - u)
                    if away >= closest:
                        continue
                    closest = away
                elif found >= 0 and right - found > 1.0:
                    clash = True
                found = right
            if clash:
                reason[y, x] = _AMBIGUOUS
            elif found >= 0:
                x_right[y, x] = found
                reason[y, x] = _VALID
    return x_right, reason
