"""From matches on the canvas to matches of the left sensor's own pixels.

The canvas decides which fringe of the right view belongs to a pixel; where on it is then solved once more with the
sensor pixel's own phase, which was never resampled, by Newton steps on the phase difference along the canvas row.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from models.stereo.candidates import wrap

_ITERATIONS = 4
_AGREE = 1.5
"""Canvas pixels within which neighbouring matches count as one surface."""


@numba.njit(cache=True, inline="always")
def _difference(phase, carrier, y, x, fy, fx, target):  # type: ignore[no-untyped-def]
    """Phase at a fractional canvas point minus target (wrapped, bilinear), and its slope along x."""
    a = wrap(phase[carrier, y, x] - target)
    b = a + wrap(phase[carrier, y, x + 1] - phase[carrier, y, x])
    c = wrap(phase[carrier, y + 1, x] - target)
    d = c + wrap(phase[carrier, y + 1, x + 1] - phase[carrier, y + 1, x])
    slope = (1 - fy) * (b - a) + fy * (d - c)
    return (1 - fy) * a + fy * c + fx * slope, slope


@numba.njit(cache=True, parallel=True)
def refine_on_sensor(match, canvas_of_left, phase, modulation, usable, phase_r, usable_r, weights):  # type: ignore[no-untyped-def]
    """Right canvas column of every usable left sensor pixel.

    match: float32 (h, w), right column of each left canvas pixel, NaN where unmatched. canvas_of_left: (H, W, 2).
    phase, modulation: float32 (C, H, W) of the left sensor. usable: bool (H, W). phase_r: float32 (C, h, w_right).
    weights: (C,) relative inverse phase variance of each carrier at equal modulation; the carriers' columns are fused
    by them. Returns x_right float64 (H, W), NaN where none, and low float32 (H, W), remaining low-phase difference,
    rad.
    """
    carriers, height, width = phase.shape
    canvas_height, canvas_width = match.shape
    right_height, right_width = usable_r.shape
    x_right = np.full((height, width), np.nan, np.float64)
    low = np.zeros((height, width), np.float32)
    for i in numba.prange(height):
        for k in range(width):
            if not usable[i, k]:
                continue
            xc, yc = canvas_of_left[i, k, 0], canvas_of_left[i, k, 1]
            x0, y0 = math.floor(xc), math.floor(yc)
            if x0 < 0 or y0 < 0 or x0 + 1 >= canvas_width or y0 + 1 >= min(canvas_height, right_height):
                continue
            right = _predict(match, xc, yc, x0, y0)
            if math.isnan(right):
                continue
            fy = yc - y0
            ok = True
            start = right
            for _ in range(_ITERATIONS):
                xr = math.floor(right)
                if xr < 0 or xr + 1 >= right_width or abs(right - start) > 3.0:
                    ok = False
                    break
                near = usable_r[y0, xr] and usable_r[y0, xr + 1] and usable_r[y0 + 1, xr] and usable_r[y0 + 1, xr + 1]
                if not near:
                    ok = False
                    break
                pull = 0.0
                stiffness = 0.0
                for c in range(carriers):
                    if weights[c] <= 0:
                        continue
                    difference, slope = _difference(phase_r, c, y0, xr, fy, right - xr, phase[c, i, k])
                    w = weights[c] * modulation[c, i, k] ** 2
                    pull += w * slope * difference
                    stiffness += w * slope * slope
                if stiffness <= 1e-12:
                    ok = False
                    break
                right -= min(2.0, max(-2.0, pull / stiffness))
            if not ok:
                continue
            xr = math.floor(right)
            if xr < 0 or xr + 1 >= right_width:
                continue
            x_right[i, k] = right
            if carriers > 1:
                low[i, k] = _difference(phase_r, 1, y0, xr, fy, right - xr, phase[1, i, k])[0]
    return x_right, low


@numba.njit(cache=True, inline="always")
def _predict(match, xc, yc, x0, y0):  # type: ignore[no-untyped-def]
    """Right column expected at a fractional canvas point: the nearest matched corner and those that agree with it."""
    nearest = np.nan
    closest = 4.0
    for dy in range(2):
        for dx in range(2):
            value = match[y0 + dy, x0 + dx]
            distance = (xc - x0 - dx) ** 2 + (yc - y0 - dy) ** 2
            if not math.isnan(value) and distance < closest:
                closest = distance
                nearest = value + (xc - x0 - dx)
    if math.isnan(nearest):
        return nearest
    total = 0.0
    weight = 0.0
    for dy in range(2):
        for dx in range(2):
            value = match[y0 + dy, x0 + dx] + (xc - x0 - dx)
            if abs(value - nearest) < _AGREE:
                w = (1.0 - abs(xc - x0 - dx)) * (1.0 - abs(yc - y0 - dy)) + 1e-3
                total += w * value
                weight += w
    return total / weight
