"""Projector columns carried from pixels with a point to neighbours without one, along surfaces that both phases show.

A pixel at the rim of what the right camera resolves has no partner to interpolate between there. Its own phases and
those of the pixel beside it, whose fringe order the three devices agreed on, tell its order all the same.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from models.stereo.candidates import wrap

Array = npt.NDArray[np.float64]
_TWO_PI = 2 * math.pi


@numba.njit(cache=True, parallel=True)
def _one_ring(column, wanted, high, low, periods, tolerance, grown):  # type: ignore[no-untyped-def]
    height, width = column.shape
    ratio = periods[0] / periods[1]
    for y in numba.prange(height):
        for x in range(width):
            grown[y, x] = column[y, x]
            if not wanted[y, x] or not math.isnan(column[y, x]):
                continue
            best = tolerance
            for k in range(4):
                j = y + (k == 0) - (k == 1)
                i = x + (k == 2) - (k == 3)
                if j < 0 or i < 0 or j >= height or i >= width or math.isnan(column[j, i]):
                    continue
                step = wrap(high[y, x] - high[j, i])
                told = column[j, i] + step * periods[0] / _TWO_PI
                turn = _TWO_PI * told / periods[1] - low[y, x]
                against_low = abs(turn - _TWO_PI * math.floor(turn / _TWO_PI + 0.5))
                against_step = abs(wrap(low[y, x] - low[j, i]) - ratio * step)
                doubt = max(against_low, against_step)
                if doubt < best:
                    best = doubt
                    grown[y, x] = told


def grow_columns(
    column: Array, wanted: npt.NDArray[np.bool_], high: Array, low: Array, periods: Array, tolerance: float, reach: int
) -> Array:
    """Columns of wanted pixels up to ``reach`` pixels from known ones, float64 (H, W), NaN where none.

    column: float64 (H, W), NaN where unknown. wanted: bool (H, W). high, low: float64 (H, W), wrapped phases.
    periods: (high, low) in columns. tolerance: rad, by which the low phase may contradict a column, and the steps of
    both phases from a pixel to the next may contradict one another. Each ring uses the one before it alone, so that
    the result does not depend on the order of pixels.
    """
    known = np.isfinite(column)
    for _ in range(reach):
        grown = np.empty_like(column)
        _one_ring(column, wanted, high, low, periods, tolerance, grown)
        column = grown
    return np.where(known, np.nan, column)


@numba.njit(cache=True, parallel=True)
def contradicted(x_right, row, wanted, phase, phase_r, usable_r, limits):  # type: ignore[no-untyped-def]
    """Where the right view shows other phases than the left one at a point's place, bool (H, W).

    x_right, row: float64 (H, W), the point on the right canvas. wanted: bool (H, W). phase: float32 (C, H, W), left.
    phase_r: float32 (C, h, w). usable_r: bool (h, w). limits: (C,) rad. Where the right view has no phase it
    contradicts nothing.
    """
    height, width = wanted.shape
    out = np.zeros((height, width), np.bool_)
    for y in numba.prange(height):
        for x in range(width):
            if not wanted[y, x] or math.isnan(x_right[y, x]):
                continue
            i, j = math.floor(x_right[y, x]), math.floor(row[y, x] + 0.5)
            if i < 0 or j < 0 or i + 1 >= usable_r.shape[1] or j >= usable_r.shape[0]:
                continue
            if not (usable_r[j, i] and usable_r[j, i + 1]):
                continue
            share = x_right[y, x] - i
            for c in range(phase.shape[0]):
                there = phase_r[c, j, i] + share * wrap(phase_r[c, j, i + 1] - phase_r[c, j, i])
                turn = there - phase[c, y, x]
                if abs(turn - _TWO_PI * math.floor(turn / _TWO_PI + 0.5)) > limits[c]:
                    out[y, x] = True
    return out
