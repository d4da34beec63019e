"""The result: an organised point map on the left sensor's grid, with its own doubt beside every point."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

Float32Array = npt.NDArray[np.float32]
UInt8Array = npt.NDArray[np.uint8]


class Reason(IntEnum):
    """Why a pixel has no point; the values of ``PointMap.mask``."""

    VALID = 0
    UNLIT = 1
    LOW_MODULATION = 2
    SATURATED = 3
    NO_MATCH = 4
    AMBIGUOUS = 5
    OUT_OF_RANGE = 6
    ISOLATED = 7


class Origin(IntEnum):
    """Which pair of devices gave a point; the values of ``PointMap.origin`` (0 where there is no point)."""

    NONE = 0
    LEFT_RIGHT = 1
    LEFT_PROJECTOR = 2


@dataclass(frozen=True, eq=False)
class PointMap:
    """Organised points of shape (H, W) on the left sensor's pixels, left-camera frame (x right, y down, z forward), mm.

    points: (H, W, 3) float32, NaN in all three coordinates where invalid. normals: (H, W, 3) float32 unit vectors
    towards the camera, NaN where unknown. confidence: float32 0..1, larger is better, 0 where invalid.
    intensity: float32, the scene without fringes, share of the sensor's full scale. modulation: float32, amplitude of
    the high carrier, likewise. phase_high, phase_low: float32 rad, 2 pi u / period mod 2 pi, finite wherever points are
    (phase_low is NaN throughout for a one-carrier capture). origin, mask: uint8 ``Origin`` and ``Reason``.
    """

    points: Float32Array
    normals: Float32Array
    confidence: Float32Array
    intensity: Float32Array
    modulation: Float32Array
    phase_high: Float32Array
    phase_low: Float32Array
    origin: UInt8Array
    mask: UInt8Array

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> PointMap:
        """A map (H, W) without any point: what a failed reconstruction counts as in a comparison."""
        vectors, plane = np.full((*shape, 3), np.nan, np.float32), np.full(shape, np.nan, np.float32)
        zeros, codes = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        mask = np.full(shape, Reason.NO_MATCH, np.uint8)
        return cls(vectors, vectors, zeros, zeros, zeros, plane, plane, codes, mask)

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.mask.shape[0], self.mask.shape[1]

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """Pixels that carry a point, (H, W)."""
        return np.asarray(self.mask == Reason.VALID)

    @property
    def depth(self) -> Float32Array:
        """z in mm, (H, W), NaN where invalid."""
        return self.points[..., 2]

    def __len__(self) -> int:
        return int(np.count_nonzero(self.mask == Reason.VALID))
