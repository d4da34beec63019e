"""One calibrated device: a camera, or a projector seen as an inverse camera, in OpenCV's pinhole model."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from models.errors import CalibrationError

FloatArray = npt.NDArray[np.float64]
DISTORTION_TERMS = (4, 5, 8, 12, 14)
"""Lengths of OpenCV's distortion vector (k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 taux tauy)."""
MAXIMUM_SIDE = 1 << 16
"""Pixels along one side of the largest sensor or raster that is believed."""
_FOLD_RADII = np.linspace(0.0, 8.0, 8001)
_UNDISTORT_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-12)


def _identity() -> FloatArray:
    return np.eye(3)


def _zeros() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Device:
    """Intrinsics, distortion and pose of one device.

    size: (width, height) in pixels or mirrors. matrix: (3, 3). distortion: OpenCV's order, 4, 5, 8, 12 or 14 terms.
    rotation (3, 3) and translation (3,), mm, map left-camera coordinates into this device's: X_dev = R X_left + T.
    Pixel and mirror centres are at integers. Raises CalibrationError for values no device can have.
    """

    size: tuple[int, int]
    matrix: FloatArray
    distortion: FloatArray
    rotation: FloatArray = field(default_factory=_identity)
    translation: FloatArray = field(default_factory=_zeros)
    name: str = "device"

    def __post_init__(self) -> None:
        shapes = {"matrix": (3, 3), "rotation": (3, 3), "translation": (3,)}
        for key, shape in shapes.items():
            self._set_array(key, shape)
        self._set_array("distortion", None)
        if self.distortion.size not in DISTORTION_TERMS:
            raise CalibrationError(
                f"{self.name}: distortion has {self.distortion.size} terms; OpenCV knows {DISTORTION_TERMS}"
            )
        if len(self.size) != 2 or not all(1 <= n <= MAXIMUM_SIDE for n in self.size):
            raise CalibrationError(f"{self.name}: size must be [width, height] in pixels, got {list(self.size)}")
        if (
            self.fx <= 0
            or self.fy <= 0
            or abs(self.matrix[2, 2] - 1) > 1e-9
            or np.abs(self.matrix[[0, 1, 2, 2], [1, 0, 0, 1]]).max() > 1e-9
        ):
            raise CalibrationError(
                f"{self.name}: matrix is singular or not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0; "
                "OpenCV's model has no skew"
            )
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(self.rotation) < 0:
            raise CalibrationError(
                f"{self.name}: rotation is not a rotation matrix (rows must be orthonormal, determinant +1)"
            )

    def _set_array(self, key: str, shape: tuple[int, ...] | None) -> None:
        try:
            given = np.asarray(getattr(self, key))
        except (TypeError, ValueError) as error:
            raise CalibrationError(f"{self.name}: {key} is not an array of numbers") from error
        if given.dtype.kind not in "iuf":
            raise CalibrationError(f"{self.name}: {key} is not an array of numbers")
        array = np.array(given, np.float64)
        if shape is None or array.size == int(np.prod(shape)):
            array = array.reshape(shape or -1)
        else:
            raise CalibrationError(f"{self.name}: {key} has shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise CalibrationError(f"{self.name}: {key} contains NaN or infinite values")
        array.setflags(write=False)
        object.__setattr__(self, key, array)

    @property
    def width(self) -> int:
        return self.size[0]

    @property
    def height(self) -> int:
        return self.size[1]

    @property
    def fx(self) -> float:
        return float(self.matrix[0, 0])

    @property
    def fy(self) -> float:
        return float(self.matrix[1, 1])

    @property
    def centre(self) -> FloatArray:
        """Centre of projection in left-camera coordinates, (3,) mm."""
        return np.asarray(-self.rotation.T @ self.translation, np.float64)

    @cached_property
    def fold_radius(self) -> float:
        """Largest x/z at which radial distortion still grows; infinite for a lens model that never folds back."""
        k1, k2, _, _, k3, k4, k5, k6 = np.pad(self.distortion, (0, 8))[:8]
        r2 = _FOLD_RADII**2
        with np.errstate(all="ignore"):
            distorted = _FOLD_RADII * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
            folds = np.flatnonzero(~(np.diff(distorted) > 0))
        return float(_FOLD_RADII[folds[0]]) if folds.size else float("inf")

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Pixels (..., 2) of left-frame points (..., 3) in mm.

        NaN for points not in front of the device, and for those so far off its axis that the lens model folds back
        and would show them on the sensor again.
        """
        array = np.asarray(points, np.float64)
        local = array.reshape(-1, 3) @ self.rotation.T + self.translation
        with np.errstate(over="ignore", invalid="ignore"):
            off_axis = np.hypot(local[:, 0], local[:, 1])
            seen = (local[:, 2] > 1e-9) & (off_axis <= self.fold_radius * local[:, 2])
        pixels = np.full((len(local), 2), np.nan)
        if seen.any():
            origin: Any = np.zeros(3)
            projected, _ = cv2.projectPoints(local[seen], origin, origin, self.matrix, self.distortion)
            pixels[seen] = projected.reshape(-1, 2)
        return pixels.reshape(*array.shape[:-1], 2)

    def undistort(self, pixels: npt.ArrayLike) -> FloatArray:
        """Normalised image coordinates (x/z, y/z) in the device's own frame, (..., 2), of pixels (..., 2)."""
        array = np.asarray(pixels, np.float64)
        flat = np.ascontiguousarray(array.reshape(-1, 1, 2))
        if flat.size == 0:
            return np.zeros_like(array)
        normalised = cv2.undistortPoints(
            flat, self.matrix, self.distortion, R=np.eye(3), P=np.eye(3), criteria=_UNDISTORT_CRITERIA
        )
        return np.asarray(normalised, np.float64).reshape(array.shape)

    def rays(self, pixels: npt.ArrayLike) -> FloatArray:
        """Directions (..., 3) in the left frame of the lines of sight of pixels (..., 2); the device's own z is 1."""
        normalised = self.undistort(pixels)
        local = np.concatenate([normalised, np.ones((*normalised.shape[:-1], 1))], axis=-1)
        return np.asarray(local @ self.rotation, np.float64)

    def back_project(self, pixels: npt.ArrayLike, depth: npt.ArrayLike) -> FloatArray:
        """Left-frame points (..., 3), mm, at the given depth along the device's own z axis, mm."""
        return self.centre + self.rays(pixels) * np.asarray(depth, np.float64)[..., None]

    def pixel_grid(self) -> FloatArray:
        """Integer pixel coordinates (height, width, 2) as float64, x first."""
        y, x = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        return np.stack([x, y], axis=-1)

    def contains(self, pixels: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether pixels (..., 2) lie on the sensor, its half-pixel border included; False for NaN."""
        array = np.asarray(pixels, np.float64)
        inside = (array >= -0.5) & (array <= np.array(self.size) - 0.5)
        return np.asarray(inside.all(axis=-1))
