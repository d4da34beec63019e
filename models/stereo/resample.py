"""Resampling at exact coordinates.

OpenCV's remap rounds coordinates to 1/32 px, which at eight pixels a fringe is a ripple of 0.012 rad, more than the
noise of a reference capture.
"""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, inline="always")
def _cubic(t, w):  # type: ignore[no-untyped-def]
    """Weights of the four neighbours for a fraction t (Catmull-Rom, Keys 1981 with a = -1/2)."""
    w[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    w[1] = (1.5 * t - 2.5) * t * t + 1.0
    w[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    w[3] = (0.5 * t - 0.5) * t * t


@numba.njit(cache=True, parallel=True)
def resample(channels, usable, where, linear):  # type: ignore[no-untyped-def]
    """Channels at fractional positions, and whether all that contributes there is usable.

    channels: float32 (N, H, W), finite. usable: bool (H, W). where: float32 (h, w, 2), x first. linear: how many of
    the last channels take only the 2x2 nearest pixels, because values beyond may mean nothing. Returns float32
    (N, h, w), border values repeated outside, and bool (h, w): inside, with the 2x2 nearest pixels usable.
    """
    count, height, width = channels.shape
    rows, columns = where.shape[:2]
    out = np.empty((count, rows, columns), np.float32)
    good = np.zeros((rows, columns), np.bool_)
    for i in numba.prange(rows):
        wx = np.empty(4, np.float64)
        wy = np.empty(4, np.float64)
        for k in range(columns):
            x, y = where[i, k, 0], where[i, k, 1]
            inside = x >= 0 and y >= 0 and x <= width - 1 and y <= height - 1
            x = min(max(x, 0.0), width - 1.0)
            y = min(max(y, 0.0), height - 1.0)
            x0 = min(math.floor(x), width - 2)
            y0 = min(math.floor(y), height - 2)
            _cubic(x - x0, wx)
            _cubic(y - y0, wy)
            good[i, k] = (
                inside and usable[y0, x0] and usable[y0, x0 + 1] and usable[y0 + 1, x0] and usable[y0 + 1, x0 + 1]
            )
            fx, fy = x - x0, y - y0
            for n in range(count - linear, count):
                upper = (1 - fx) * channels[n, y0, x0] + fx * channels[n, y0, x0 + 1]
                lower = (1 - fx) * channels[n, y0 + 1, x0] + fx * channels[n, y0 + 1, x0 + 1]
                out[n, i, k] = (1 - fy) * upper + fy * lower
            for n in range(count - linear):
                total = 0.0
                for b in range(4):
                    yy = min(max(y0 + b - 1, 0), height - 1)
                    line = 0.0
                    for a in range(4):
                        xx = min(max(x0 + a - 1, 0), width - 1)
                        line += wx[a] * channels[n, yy, xx]
                    total += wy[b] * line
                out[n, i, k] = total
    return out, good
