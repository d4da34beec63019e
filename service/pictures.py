"""Result maps as pictures: depth, wrapped phase, depth error, shaded surface. All pictures are uint8 BGR (H, W, 3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.atomic import atomic_file
from models.errors import ExportError

Picture = npt.NDArray[np.uint8]
FloatMap = npt.NDArray[np.floating]

INVALID_GREY = 236
_ERROR_COLOURS_RGB = ((5, 48, 97), (67, 147, 195), (247, 247, 247), (214, 96, 77), (103, 0, 31))
"""Blue through white to red: what lies in front of the truth, on it, behind it."""
_LIGHT = np.array([0.35, -0.5, -0.8]) / np.linalg.norm([0.35, -0.5, -0.8])
"""Direction towards the light of shaded pictures, left-camera frame: above, to the right, behind the camera."""
_SURFACE_BGR = np.array([214.0, 208.0, 200.0])


@dataclass(frozen=True)
class ColourScale:
    """Colours of the values from ``low`` to ``high``; ``table`` is uint8 BGR (256, 3)."""

    table: Picture
    low: float
    high: float
    unit: str

    def paint(self, values: FloatMap) -> Picture:
        """Colours of a map (H, W); values outside are clipped, NaN is light grey."""
        share = (np.asarray(values, np.float64) - self.low) / (self.high - self.low)
        index = np.clip(np.nan_to_num(share) * 255, 0, 255).astype(np.uint8)
        return np.where(np.isnan(share)[..., None], np.uint8(INVALID_GREY), self.table[index])

    def bar(self, height: int, width: int) -> Picture:
        """The scale itself, high values at the top."""
        shares = np.linspace(255, 0, height).astype(np.uint8)
        return np.repeat(self.table[shares][:, None], width, axis=1)


@cache
def _opencv_table(colormap: int) -> Picture:
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    return np.asarray(cv2.applyColorMap(ramp, colormap)[:, 0], np.uint8)


@cache
def _error_table() -> Picture:
    stops = np.linspace(0, 255, len(_ERROR_COLOURS_RGB))
    channels = [np.interp(np.arange(256), stops, [c[i] for c in _ERROR_COLOURS_RGB]) for i in (2, 1, 0)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


def depth_scale(depth_range: tuple[float, float]) -> ColourScale:
    """Scale for depths in mm."""
    return ColourScale(_opencv_table(cv2.COLORMAP_TURBO), *depth_range, "mm")


def tight_range(depth: FloatMap) -> tuple[float, float]:
    """Range that holds nearly all finite depths, whole millimetres; (0, 1) where there are none."""
    finite = depth[np.isfinite(depth)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = np.percentile(finite, [0.5, 99.5])
    return float(np.floor(low)), float(max(np.ceil(high), np.floor(low) + 1))


def phase_scale() -> ColourScale:
    """Cyclic scale for wrapped phases in radians."""
    return ColourScale(_opencv_table(cv2.COLORMAP_TWILIGHT), -np.pi, np.pi, "rad")


def error_scale(limit_mm: float) -> ColourScale:
    """Scale for signed depth errors in mm: blue lies too near, red too far."""
    return ColourScale(_error_table(), -limit_mm, limit_mm, "mm")


def share_scale() -> ColourScale:
    """Scale for shares of 0..1, as a certainty."""
    return ColourScale(_opencv_table(cv2.COLORMAP_VIRIDIS), 0.0, 1.0, "")


def grey_picture(image: npt.ArrayLike, white_level: float) -> Picture:
    """A camera image (H, W) of any depth as it would show on a screen."""
    share = np.clip(np.asarray(image, np.float64) / white_level, 0, 1)
    return np.repeat(np.rint(255 * share).astype(np.uint8)[..., None], 3, axis=2)


def shaded_picture(normals: FloatMap, smoothing: float = 0.0) -> Picture:
    """A surface lit from above, from unit normals (H, W, 3) towards the camera; pixels without one are light grey.

    smoothing: standard deviation (px) of a Gaussian over which the normals are averaged before they are shaded.
    """
    filled: FloatMap = np.nan_to_num(normals).astype(np.float32)
    if smoothing > 0:
        filled = np.asarray(cv2.GaussianBlur(filled, (0, 0), smoothing))
        filled = filled / np.maximum(np.linalg.norm(filled, axis=2, keepdims=True), 1e-6)
    cosine = np.clip(filled @ _LIGHT, 0, 1)
    lit = np.rint((0.15 + 0.85 * cosine)[..., None] * _SURFACE_BGR).astype(np.uint8)
    return np.where(np.isnan(normals[..., :1]), np.uint8(INVALID_GREY), lit)


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture as PNG, atomically; raises DuofringeError when the folder does not exist."""
    with atomic_file(path) as partial:
        if not cv2.imwrite(str(partial), picture):
            raise ExportError(f"{path}: could not be written")
