"""Path-wise aggregation over sub-pixel candidates: a labelling problem over a few candidates a pixel.

As in semi-global matching, the cost of each candidate gathers along straight paths; unlike there, labels are not
integer disparities but each pixel's own candidates. A candidate is continued by the neighbour's candidate nearest to
it: aliases lie a whole fringe apart, so even a steep surface continues without cost and only a change of fringe pays.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from models.stereo.candidates import Candidates

Float32Array = npt.NDArray[np.float32]
PATHS = 8
_FREE_STEP = 1.6
"""Canvas columns by which a continuous surface may leave its fronto-parallel continuation in one pixel."""
_BLOCK = 32
"""Neighbouring paths that one thread carries forward together, for the sake of the cache."""


def aggregate(candidates: Candidates, jump_cost: float) -> Float32Array:
    """Aggregated cost of every candidate, float32 (h, w, K): the sum over eight paths.

    jump_cost: what a change of fringe from one pixel to the next costs along a path.
    """
    total = np.zeros_like(candidates.cost)
    x, cost, count = candidates.x_right, candidates.cost, candidates.count
    for dx in (1, -1):
        _along_rows(x, cost, count, total, dx, np.float32(jump_cost))
    for dy, dx in ((1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        _across_rows(x, cost, count, total, dy, dx, np.float32(jump_cost))
    return total


@numba.njit(cache=True, inline="always")
def _step(x_from, cost_from, n_from, x_to, cost_to, n_to, shift, jump, out):  # type: ignore[no-untyped-def]
    """One step of a path: out[i] = cost_to[i] + cheapest way from the previous pixel, less its minimum."""
    floor = np.float32(np.inf)
    for j in range(n_from):
        floor = min(floor, cost_from[j])
    j = 0
    for i in range(n_to):
        best = jump
        if n_from > 0:
            target = x_to[i] - shift
            while j + 1 < n_from and abs(x_from[j + 1] - target) <= abs(x_from[j] - target):
                j += 1
            away = abs(x_from[j] - target)
            if away < 2 * _FREE_STEP:
                extra = jump * max(np.float32(0), away / np.float32(_FREE_STEP) - np.float32(1))
                best = min(best, cost_from[j] - floor + extra)
        else:
            best = np.float32(0)
        out[i] = cost_to[i] + best


@numba.njit(cache=True, parallel=True)
def _along_rows(x, cost, count, total, dx, jump):  # type: ignore[no-untyped-def]
    height, width, limit = x.shape
    for y in numba.prange(height):
        path = np.zeros(limit, np.float32)
        following = np.zeros(limit, np.float32)
        for step in range(width):
            c = step if dx > 0 else width - 1 - step
            n = count[y, c]
            p = c - dx
            m = 0
            if step > 0:
                m = count[y, p]
            p = max(0, min(width - 1, p))
            _step(x[y, p], path, m, x[y, c], cost[y, c], n, dx, jump, following)
            for i in range(n):
                total[y, c, i] += following[i]
                path[i] = following[i]


@numba.njit(cache=True, parallel=True)
def _across_rows(x, cost, count, total, dy, dx, jump):  # type: ignore[no-untyped-def]
    """Paths down or up the rows. Each goes its way alone, so threads meet once a direction and not once a row."""
    height, width, limit = x.shape
    first = min(0, -dx * (height - 1))
    last = width + max(0, -dx * (height - 1))
    for block in numba.prange((last - first + _BLOCK - 1) // _BLOCK):
        start = first + block * _BLOCK
        paths = np.zeros((_BLOCK, limit), np.float32)
        following = np.zeros(limit, np.float32)
        for step in range(height):
            y = step if dy > 0 else height - 1 - step
            previous = max(0, min(height - 1, y - dy))
            shift = dx * step
            for c in range(max(0, start + shift), min(width, start + _BLOCK + shift)):
                path = paths[c - shift - start]
                n = count[y, c]
                p = c - dx
                m = 0
                if step > 0 and p >= 0 and p < width:
                    m = count[previous, p]
                p = max(0, min(width - 1, p))
                _step(x[previous, p], path, m, x[y, c], cost[y, c], n, dx, jump, following)
                for i in range(n):
                    total[y, c, i] += following[i]
                    path[i] = following[i]


@numba.njit(cache=True, parallel=True)
def cheapest(total, count):  # type: ignore[no-untyped-def]
    """Index (uint8) of the candidate with the smallest aggregated cost, and how much dearer the runner-up is, or inf.

    total: float32 (h, w, K). count: uint8 (h, w). Both results are (h, w); the index is 0 where there is no candidate.
    """
    height, width = count.shape
    index = np.zeros((height, width), np.uint8)
    margin = np.full((height, width), np.inf, np.float32)
    for y in numba.prange(height):
        for x in range(width):
            best = np.float32(np.inf)
            second = np.float32(np.inf)
            for i in range(count[y, x]):
                if total[y, x, i] < best:
                    second = best
                    best = total[y, x, i]
                    index[y, x] = i
                elif total[y, x, i] < second:
                    second = total[y, x, i]
            if count[y, x] > 1:
                margin[y, x] = second - best
    return index, margin
