"""Reference matching: the point on the right row with the same absolute projector column."""

from __future__ import annotations

import math

import numba
import numpy as np

from models.points import Reason

_VALID, _NO_MATCH, _AMBIGUOUS = int(Reason.VALID), int(Reason.NO_MATCH), int(Reason.AMBIGUOUS)
_STEEPEST = 3.0
"""Projector columns per canvas pixel; a steeper step between right pixels is an edge."""


@numba.njit(cache=True, parallel=True)
def match_columns(column_l, column_r, usable_l, usable_r, frame, turn, depth_range):  # type: ignore[no-untyped-def]
    """Right canvas column for every left canvas pixel, and the reason where there is none.

    column_l, column_r: float32 (h, w) projector columns. frame, turn, depth_range as in ``find_candidates``.
    Returns x_right float32 (h, w), NaN where unmatched, and reason uint8 (h, w): NO_MATCH, or AMBIGUOUS where two
    crossings lie more than a pixel apart.
    """
    height, width = column_l.shape
    right_width = column_r.shape[1]
    focal, baseline, cx_l, cx_r, cy = frame
    x_right = np.full((height, width), np.nan, np.float32)
    reason = np.full((height, width), _NO_MATCH, np.uint8)
    for y in numba.prange(height):
        down = (y - cy) / focal
        for x in range(width):
            if not usable_l[y, x]:
                continue
            across = (x - cx_l) / focal
            per_z = turn[2, 0] * across + turn[2, 1] * down + turn[2, 2]
            first = x - cx_l - focal * baseline * per_z / depth_range[0] + cx_r
            last = x - cx_l - focal * baseline * per_z / depth_range[1] + cx_r
            start = max(0, int(math.floor(first)))
            stop = min(right_width - 2, int(math.ceil(last)))
            u = column_l[y, x]
            found = -1.0
            clash = False
            for j in range(start, stop + 1):
                if not (usable_r[y, j] and usable_r[y, j + 1]):
                    continue
                behind = column_r[y, j] - u
                ahead = column_r[y, j + 1] - u
                if behind > 0 or ahead <= 0 or ahead - behind > _STEEPEST:
                    continue
                right = j - behind / (ahead - behind)
                if found >= 0 and right - found > 1.0:
                    clash = True
                found = right
            if clash:
                reason[y, x] = _AMBIGUOUS
            elif found >= 0:
                x_right[y, x] = found
                reason[y, x] = _VALID
    return x_right, reason
