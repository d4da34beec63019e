"""Connected surfaces: what belongs together, what is too small to be believed, what two pixels claim at once."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def label_surfaces(value, tolerance):  # type: ignore[no-untyped-def]
    """Label 4-connected regions over which a map changes by less than ``tolerance`` from pixel to pixel.

    value: float (H, W), NaN where there is nothing. Returns labels int32 (H, W), -1 for NaN, and sizes int32 (n,).
    """
    height, width = value.shape
    parent = np.arange(height * width, dtype=np.int32)
    for y in range(height):
        for x in range(width):
            here = value[y, x]
            if np.isnan(here):
                continue
            if x > 0 and abs(here - value[y, x - 1]) < tolerance:
                _join(parent, y * width + x, y * width + x - 1)
            if y > 0 and abs(here - value[y - 1, x]) < tolerance:
                _join(parent, y * width + x, (y - 1) * width + x)
    labels = np.full((height, width), -1, np.int32)
    number = np.full(height * width, -1, np.int32)
    sizes = np.zeros(height * width, np.int32)
    found = 0
    for y in range(height):
        for x in range(width):
            if np.isnan(value[y, x]):
                continue
            root = _root(parent, y * width + x)
            if number[root] < 0:
                number[root] = found
                found += 1
            labels[y, x] = number[root]
            sizes[number[root]] += 1
    return labels, sizes[:found].copy()


@numba.njit(cache=True, inline="always")
def _root(parent, node):  # type: ignore[no-untyped-def]
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


@numba.njit(cache=True, inline="always")
def _join(parent, a, b):  # type: ignore[no-untyped-def]
    a, b = _root(parent, a), _root(parent, b)
    if a < b:
        parent[b] = a
    else:
        parent[a] = b


@numba.njit(cache=True, parallel=True)
def claimed_twice(x_left, x_right, y, cost, height, width, tolerance):  # type: ignore[no-untyped-def]
    """Matches whose right pixel a better match claims for another surface (uniqueness seen from the right).

    x_left, x_right, y: float (H, W), canvas coordinates of each match, x_right NaN where there is none. cost: float
    (H, W), smaller is better. height, width: of the right canvas. tolerance: px of disparity that one surface may
    differ by within a pixel. Returns bool (H, W).
    """
    rows, columns = x_right.shape
    owner_cost = np.full((height, width), np.inf, np.float32)
    owner = np.zeros((height, width), np.float32)
    for i in range(rows):
        for k in range(columns):
            if np.isnan(x_right[i, k]):
                continue
            r, c = round(y[i, k]), round(x_right[i, k])
            if 0 <= r < height and 0 <= c < width and cost[i, k] < owner_cost[r, c]:
                owner_cost[r, c] = cost[i, k]
                owner[r, c] = x_right[i, k] - x_left[i, k]
    lost = np.zeros((rows, columns), np.bool_)
    for i in numba.prange(rows):
        for k in range(columns):
            if np.isnan(x_right[i, k]):
                continue
            r, c = round(y[i, k]), round(x_right[i, k])
            if 0 <= r < height and 0 <= c < width and owner_cost[r, c] < np.inf:
                lost[i, k] = abs(x_right[i, k] - x_left[i, k] - owner[r, c]) > tolerance
    return lost
