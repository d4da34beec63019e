"""The light of whatever stands on the mirrors, known as an image and not as a pattern."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.simulator.optics import Float32Array, Optics, Profile, light_share, profile_of
from models.patterns import Raster

MirrorLevels = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Picture:
    """Light that varies along u and v: share of full white (rows, n) at u = j / ``per_column``, read to 1/32 of a step.

    profile: its mean along v, which is enough for light that reaches a surface by way of another.
    """

    light: Float32Array
    per_column: int
    profile: Profile

    def at(self, columns: Float32Array, rows: Float32Array) -> Float32Array:
        """Share of full white at mirror coordinates of any common shape (A, B); dark beyond the mirrors."""
        return np.asarray(
            cv2.remap(self.light, columns * np.float32(self.per_column), rows, cv2.INTER_LINEAR), np.float32
        )


def light_of(levels: MirrorLevels, raster: Raster, optics: Optics, rows_per_column: float) -> Profile | Picture:
    """What leaves the projector while its mirrors hold ``levels`` (rows, columns).

    An image that varies along one axis only is as exact as the pattern that it was made from.
    """
    if raster.kind == "square" and not np.any(levels != levels[:1]):
        return profile_of(levels[0], raster, optics, rows_per_column, row_coded=False)
    if raster.kind == "diamond" and not (np.any(levels[::2] != levels[0]) or np.any(levels[1::2] != levels[1])):
        return profile_of(levels[:2].T.ravel(), raster, optics, rows_per_column, row_coded=False)
    if not np.any(levels != levels[:, :1]):
        return profile_of(levels[:, 0], raster, optics, rows_per_column, row_coded=True)
    return _picture(levels, raster, optics, rows_per_column)


def _picture(levels: MirrorLevels, raster: Raster, optics: Optics, rows_per_column: float) -> Picture:
    light = light_share(levels, optics).astype(np.float32)
    sigma = (optics.defocus_columns, optics.defocus_columns * rows_per_column)
    if raster.kind == "square":
        mean = profile_of(levels.mean(axis=0), raster, optics, rows_per_column, row_coded=False)
        return Picture(_blurred(light, sigma), 1, mean)
    lattice = np.zeros((raster.rows, 2 * raster.columns), np.float32)
    lattice[::2, ::2], lattice[1::2, 1::2] = light[::2], light[1::2]
    # each mirror is a diamond that ends at its neighbours' centres; their sum is one everywhere
    diamond = np.array([0.5, 1.0, 0.5], np.float32)
    filled = cv2.sepFilter2D(lattice, cv2.CV_32F, diamond, diamond / 2, borderType=cv2.BORDER_REFLECT_101)
    by_parity = np.stack([levels[::2].mean(axis=0), levels[1::2].mean(axis=0)], axis=1).ravel()
    mean = profile_of(by_parity, raster, optics, rows_per_column, row_coded=False)
    return Picture(_blurred(np.asarray(filled), (2 * sigma[0], sigma[1])), 2, mean)


def _blurred(light: Float32Array, sigma: tuple[float, float]) -> Float32Array:
    if min(sigma) <= 0:
        return light
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigmaX=sigma[0], sigmaY=sigma[1]), np.float32)
