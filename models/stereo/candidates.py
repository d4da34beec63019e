"""Sub-pixel match candidates: the points on the right row where the high phases are equal.

Half a pixel of camera is 0.35 rad of high phase, more than what tells a match from its alias, so candidates are
the interpolated zero crossings of the phase difference, and the low phase is compared there (paper,
Phase-based Candidate Reduction, made sub-pixel).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from models.geometry.projection import project_point
from models.stereo.search import search_interval

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
_TWO_PI = 2 * math.pi
_STEEPEST = 2.4
"""rad/px of high phase; steeper steps between right pixels are edges, not fringes."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates of every left canvas pixel, ordered by right column.

    x_right: float32 (h, w, K). cost: float32 (h, w, K), 0 is perfect agreement. count: uint8 (h, w).
    """

    x_right: Float32Array
    cost: Float32Array
    count: npt.NDArray[np.uint8]


@dataclass(frozen=True)
class CandidateSettings:
    """Scales of the matching cost.

    low_scale: rad of low-phase difference between the views that costs 1 (the paper's tau_l).
    high_scale, projector_low_scale: rad between a view's phases and those the projector shows at the candidate's point.
    texture_weight: cost of a relative texture difference of 1 between the views.
    misfit_scale: misfit at which the evidence of a pixel counts half.
    surplus: a candidate dearer than the pixel's cheapest by more is dropped (the paper's candidate test).
    limit: largest number of candidates a pixel keeps.
    """

    low_scale: float = 0.9
    high_scale: float = 0.9
    projector_low_scale: float = 0.7
    texture_weight: float = 1.0
    misfit_scale: float = 0.5
    surplus: float = 2.0
    limit: int = 32


@numba.njit(cache=True, inline="always")
def wrap(angle):  # type: ignore[no-untyped-def]
    """Angle in [-pi, pi) of an angle in [-3 pi, 3 pi): differences of wrapped phases need no division."""
    if angle >= math.pi:
        return angle - _TWO_PI
    if angle < -math.pi:
        return angle + _TWO_PI
    return angle


@numba.njit(cache=True, inline="always")
def wrap_any(angle):  # type: ignore[no-untyped-def]
    """Angle in [-pi, pi) of any angle."""
    return angle - _TWO_PI * math.floor(angle / _TWO_PI + 0.5)


@numba.njit(cache=True, inline="always")
def _bounded(residual, scale):  # type: ignore[no-untyped-def]
    """Squared residual in units of its scale, saturating at 2 so that one bad carrier cannot rule alone."""
    square = (residual / scale) ** 2
    return 2.0 * square / (2.0 + square)


@numba.njit(cache=True, inline="always")
def _keep_plausible(x_right, cost, n, surplus):  # type: ignore[no-untyped-def]
    """Drop candidates dearer than the cheapest by more than ``surplus``, in place; returns how many are left."""
    cheapest = np.float32(np.inf)
    for i in range(n):
        cheapest = min(cheapest, cost[i])
    kept = 0
    for i in range(n):
        if cost[i] <= cheapest + surplus:
            x_right[kept], cost[kept] = x_right[i], cost[i]
            kept += 1
    for i in range(kept, n):
        x_right[i], cost[i] = np.nan, np.inf
    return kept


@numba.njit(cache=True)
def _column_along_ray(projector, turn, focal, baseline, across, down, zero, first, last, ray):  # type: ignore[no-untyped-def]
    """Projector column along a left line of sight: u(t) = (ray0 + ray1 t) / (1 + ray2 t), t = 0..1 from right canvas
    column ``first`` to ``last``: exact without distortion, within a hundredth of a column for a mild one.

    zero: right canvas column of the line of sight's vanishing point.
    """
    for k in range(3):
        z = focal * baseline / (zero - first - 0.5 * k * (last - first))
        x, y = across * z, down * z
        ray[k], _ = project_point(
            projector,
            turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
            turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
            turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
        )
    start, middle, end = ray[0], ray[1], ray[2]
    bend = 0.0 if abs(middle - end) < 1e-9 else (start + end - 2 * middle) / (middle - end)
    ray[1] = end * (1.0 + bend) - start
    ray[2] = bend


@numba.njit(cache=True, parallel=True, fastmath={"arcp", "contract", "nsz", "reassoc"})
def find_candidates(  # type: ignore[no-untyped-def]
    phase_l,
    phase_r,
    usable_l,
    usable_r,
    texture_l,
    texture_r,
    misfit_l,
    misfit_r,
    frame,
    turn,
    depth_range,
    projector,
    periods,
    scales,
    limit,
    direction=1.0,
):
    """Candidates of all left pixels; arrays as in ``RectifiedView``.

    frame: (focal, baseline, cx_left, cx_right, cy, canvas rows from one array row to the next). turn: (3, 3), from the
    rectified to the left-camera frame. projector: vector of ``pack_projection`` or empty without a projector.
    periods: fringe periods (C,). direction: 1.0 where phases grow along the rows, -1.0 where they fall.
    scales: (low, high, projector_low, texture, misfit, surplus). Returns x_right, cost (h, w, limit) and count (h, w).
    """
    carriers, height, width = phase_l.shape
    right_width = phase_r.shape[2]
    focal, baseline, cx_l, cx_r, cy, row_step = frame
    x_right = np.empty((height, width, limit), np.float32)
    cost = np.empty((height, width, limit), np.float32)
    count = np.zeros((height, width), np.uint8)
    two_carriers = carriers > 1
    use_projector = projector.size > 0
    for y in numba.prange(height):
        down = (y * row_step - cy) / focal
        slope = np.empty(right_width, np.float32)
        for j in range(right_width - 1):
            step = direction * wrap(phase_r[0, y, j + 1] - phase_r[0, y, j])
            good = usable_r[y, j] and usable_r[y, j + 1] and step > 0.05 and step < _STEEPEST
            slope[j] = step if good else 0.0
        ray = np.zeros(3)
        x_right[y] = np.nan
        cost[y] = np.inf
        for x in range(width):
            if not usable_l[y, x]:
                continue
            across, first, last, start, stop = search_interval(x, down, frame, turn, depth_range, right_width)
            phase = phase_l[0, y, x]
            if use_projector:
                _column_along_ray(projector, turn, focal, baseline, across, down, x - cx_l + cx_r, first, last, ray)
            n = 0
            for j in range(start, stop + 1):
                if slope[j] == 0.0:
                    continue
                behind = direction * wrap(phase_r[0, y, j] - phase)
                if behind > 0 or behind + slope[j] <= 0:
                    continue
                t = -behind / slope[j]
                right = j + t
                if right < first or right > last or n == limit:
                    continue
                total = 0.0
                if two_carriers:
                    low_r = phase_r[1, y, j] + t * wrap(phase_r[1, y, j + 1] - phase_r[1, y, j])
                    total += _bounded(wrap(low_r - phase_l[1, y, x]), scales[0])
                a, b = texture_l[y, x], texture_r[y, j] + t * (texture_r[y, j + 1] - texture_r[y, j])
                total += scales[3] * min(1.0, abs(a - b) / (a + b + 0.02))
                if use_projector:
                    share = (right - first) / (last - first)
                    u = (ray[0] + ray[1] * share) / (1.0 + ray[2] * share)
                    total += _bounded(wrap_any(_TWO_PI * u / periods[0] - phase), scales[1])
                    if two_carriers:
                        middle = phase_l[1, y, x] + 0.5 * wrap(low_r - phase_l[1, y, x])
                        total += _bounded(wrap_any(_TWO_PI * u / periods[1] - middle), scales[2])
                doubt = max(misfit_l[y, x], misfit_r[y, j] + t * (misfit_r[y, j + 1] - misfit_r[y, j])) / scales[4]
                x_right[y, x, n] = right
                cost[y, x, n] = total / (1.0 + doubt * doubt)
                n += 1
            count[y, x] = _keep_plausible(x_right[y, x], cost[y, x], n, scales[5])
    return x_right, cost, count
