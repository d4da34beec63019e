"""Where on the right row a left canvas pixel can be found."""

from __future__ import annotations

import math

import numba


@numba.njit(cache=True, inline="always")
def search_interval(x, down, frame, turn, depth_range, right_width):  # type: ignore[no-untyped-def]
    """Part of the right row that the depth range allows for left canvas column ``x``.

    down: the row's direction, (row - cy) / focal. frame, turn, depth_range as in ``find_candidates``. Returns across,
    the column's direction; first and last, right canvas columns of the nearest and farthest depth; start and stop,
    the whole columns between which crossings are looked for.
    """
    focal, baseline, cx_l, cx_r, _, _ = frame
    across = (x - cx_l) / focal
    per_z = turn[2, 0] * across + turn[2, 1] * down + turn[2, 2]
    first = x - cx_l - focal * baseline * per_z / depth_range[0] + cx_r
    last = x - cx_l - focal * baseline * per_z / depth_range[1] + cx_r
    return across, first, last, max(0, math.floor(first)), min(right_width - 2, math.ceil(last))
