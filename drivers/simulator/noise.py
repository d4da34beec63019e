"""Solid gradient noise (K. Perlin, "An Image Synthesizer", SIGGRAPH 1985) for textures, blobs and reliefs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled


@compiled
def _corner(ix: int, iy: int, iz: int, seed: int, x: float, y: float, z: float) -> float:
    """Dot product of a lattice point's hashed gradient (one of twelve edge directions) with the offset from it."""
    h = np.uint32(ix) * np.uint32(73856093) ^ np.uint32(iy) * np.uint32(19349663)
    h = np.uint32(h ^ np.uint32(iz) * np.uint32(83492791) ^ np.uint32(seed) * np.uint32(2654435761))
    h = np.uint32((h ^ (h >> np.uint32(15))) * np.uint32(2246822519))
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(3266489917))
    pick = (h ^ (h >> np.uint32(16))) & np.uint32(15)
    first = x if pick < 8 else y
    second = y if pick < 4 else (x if pick in (12, 14) else z)
    return (first if pick & 1 == 0 else -first) + (second if pick & 2 == 0 else -second)


@compiled
def _noise(x: float, y: float, z: float, seed: int) -> float:
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    ix, iy, iz = int(fx), int(fy), int(fz)
    x, y, z = x - fx, y - fy, z - fz
    wx = x * x * x * (x * (x * 6 - 15) + 10)
    wy = y * y * y * (y * (y * 6 - 15) + 10)
    wz = z * z * z * (z * (z * 6 - 15) + 10)
    total = 0.0
    for dx in range(2):
        for dy in range(2):
            for dz in range(2):
                weight = (wx if dx else 1 - wx) * (wy if dy else 1 - wy) * (wz if dz else 1 - wz)
                total += weight * _corner(ix + dx, iy + dy, iz + dz, seed, x - dx, y - dy, z - dz)
    return total


@compiled
def _fractal(points: Any, seed: int, octaves: int, gain: float, out: Any) -> None:
    for i in range(points.shape[0]):
        total, weight, scale, sum_of_weights = 0.0, 1.0, 1.0, 0.0
        for octave in range(octaves):
            total += weight * _noise(
                points[i, 0] * scale, points[i, 1] * scale, points[i, 2] * scale, seed + 101 * octave
            )
            sum_of_weights += weight
            weight *= gain
            scale *= 2.03
        out[i] = total / sum_of_weights


def fractal_noise(
    points: npt.NDArray[np.floating], seed: int, octaves: int = 3, gain: float = 0.5
) -> npt.NDArray[np.float64]:
    """Noise in about -1..1, float64 (N,), at points (N, 3); its coarsest features are about one unit wide."""
    out = np.empty(len(points), np.float64)
    _fractal(np.ascontiguousarray(points, np.float64), seed & 0x7FFFFFFF, octaves, gain, out)
    return out
