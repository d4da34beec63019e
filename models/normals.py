"""Surface normals of organised points, from neighbours on the same surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

Float32Array = npt.NDArray[np.float32]

_RADIUS = 2
_MINIMUM_NEIGHBOURS = 6
_MAXIMUM_EXCESS = 2.5
"""Depth by which a neighbour may leave the local slope, in widths of a pixel on the object."""


def estimate_normals(points: Float32Array) -> Float32Array:
    """Unit normals (H, W, 3) float32 of organised points (H, W, 3) in the camera's own frame; NaN where unknown.

    Normals point towards the camera: normal . point < 0, so that z is negative on all but grazing surfaces. A plane
    n . p = d is linear in inverse depth, 1/z = (n/d) . (x/z, y/z, 1), and noise of triangulation is even there; it is
    fitted to the 5x5 neighbours that continue the local slope, so that normals do not bend across depth jumps.
    """
    x, y, inverse = _inverse_depth(np.ascontiguousarray(points, np.float32))
    normals = np.full(points.shape, np.nan, np.float32)
    _fit_planes(x, y, inverse, normals)
    return normals


@njit(cache=True, parallel=True)  # type: ignore[untyped-decorator]
def _inverse_depth(points: Float32Array) -> tuple[Float32Array, Float32Array, Float32Array]:
    """x/z, y/z and 1/z of each point; zeros where there is none."""
    height, width = points.shape[:2]
    x = np.zeros((height, width), np.float32)
    y = np.zeros((height, width), np.float32)
    inverse = np.zeros((height, width), np.float32)
    for row in prange(height):
        for column in range(width):
            px, py, pz = points[row, column]
            if np.isfinite(px) and np.isfinite(py) and np.isfinite(pz) and pz > 0:
                inverse[row, column] = 1 / pz
                x[row, column] = px / pz
                y[row, column] = py / pz
    return x, y, inverse


@njit(cache=True)  # type: ignore[untyped-decorator]
def _slope(before: float, centre: float, after: float) -> float:
    """Change of inverse depth per pixel: of both one-sided differences the flatter; 0 is an absent neighbour."""
    if before == 0 and after == 0:
        return 0.0
    if before == 0:
        return after - centre
    if after == 0:
        return centre - before
    backward = centre - before
    forward = after - centre
    return backward if abs(backward) < abs(forward) else forward


@njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _fit_plane(i: int, j: int, x: Float32Array, y: Float32Array, inverse: Float32Array) -> tuple[float, float, float]:
    """(a, b, c) of inverse depth = a x + b y + c about pixel (i, j); zeros where neighbours tell no plane."""
    height, width = inverse.shape
    w = inverse[i, j]
    left = inverse[i, j - 1] if j > 0 else 0.0
    right = inverse[i, j + 1] if j + 1 < width else 0.0
    up = inverse[i - 1, j] if i > 0 else 0.0
    down = inverse[i + 1, j] if i + 1 < height else 0.0
    slope_x = _slope(left, w, right)
    slope_y = _slope(up, w, down)
    limit = (_MAXIMUM_EXCESS * w) ** 2
    x0, y0 = x[i, j], y[i, j]
    n = 0
    sx = sy = sw = sxx = sxy = syy = sxw = syw = 0.0  # sums of the linear fit, about the centre pixel
    for di in range(max(-_RADIUS, -i), min(_RADIUS + 1, height - i)):
        for dj in range(max(-_RADIUS, -j), min(_RADIUS + 1, width - j)):
            neighbour = inverse[i + di, j + dj]
            if neighbour == 0:
                continue
            dx = x[i + di, j + dj] - x0
            dy = y[i + di, j + dj] - y0
            dw = neighbour - w
            # |dz| / z = |dw| / w, and a pixel is z |(dx, dy)| / |(dj, di)| wide: compare both in units of z
            excess = dw - (slope_x * dj + slope_y * di)
            if excess * excess * (di * di + dj * dj) > limit * (dx * dx + dy * dy):
                continue
            n += 1
            sx += dx
            sy += dy
            sw += dw
            sxx += dx * dx
            sxy += dx * dy
            syy += dy * dy
            sxw += dx * dw
            syw += dy * dw
    if n < _MINIMUM_NEIGHBOURS:
        return 0.0, 0.0, 0.0
    sxx -= sx * sx / n
    sxy -= sx * sy / n
    syy -= sy * sy / n
    sxw -= sx * sw / n
    syw -= sy * sw / n
    determinant = sxx * syy - sxy * sxy
    if determinant <= 1e-4 * sxx * syy:  # neighbours in one line
        return 0.0, 0.0, 0.0
    a = (sxw * syy - syw * sxy) / determinant
    b = (syw * sxx - sxw * sxy) / determinant
    return a, b, w + (sw - a * sx - b * sy) / n - a * x[i, j] - b * y[i, j]


@njit(cache=True, parallel=True)  # type: ignore[untyped-decorator]
def _fit_planes(x: Float32Array, y: Float32Array, inverse: Float32Array, normals: Float32Array) -> None:
    height, width = inverse.shape
    for row in prange(height):
        i = np.int64(row)  # the loop's own index is unsigned
        for j in range(width):
            if inverse[i, j] == 0:
                continue
            a, b, c = _fit_plane(i, j, x, y, inverse)
            if a * x[i, j] + b * y[i, j] + c > 0:
                length = np.sqrt(a * a + b * b + c * c)
                normals[i, j, 0] = -a / length
                normals[i, j, 1] = -b / length
                normals[i, j, 2] = -c / length
