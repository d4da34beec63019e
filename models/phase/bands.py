"""Which carrier frequencies a camera can see: from the rig's geometry, or from the image's own spectrum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from models.geometry.device import Device
from models.geometry.rig import Rig
from models.phase.windowed_fourier import Band

FloatArray = npt.NDArray[np.float64]
_STEEPEST_DEG = 50.0
"""Tilt of a surface, against the line of sight, up to which its fringes are to be passed."""
_GRID_STEP = 40


@dataclass(frozen=True)
class FringeField:
    """Fringe frequencies to expect in one view, for one projector column a fringe (divide by the period).

    zeta: (low, median, high) rad/px along x times columns; eta: (low, high) along y. sign: +1 where the projector
    column grows along x, else -1.
    """

    zeta: tuple[float, float, float]
    eta: tuple[float, float]
    sign: int


def fringe_field(rig: Rig, camera: Device, depth_range: tuple[float, float]) -> FringeField | None:
    """Range of du/dx and du/dy (rad/px of a one-column fringe) over field, depths and tilts; None without projector."""
    if rig.projector is None:
        return None
    across, down = [], []
    slopes = np.deg2rad([-_STEEPEST_DEG, -25.0, 0.0, 25.0, _STEEPEST_DEG])
    grid = camera.pixel_grid()[_GRID_STEP // 2 :: _GRID_STEP, _GRID_STEP // 2 :: _GRID_STEP].reshape(-1, 2)
    for depth in np.linspace(*depth_range, 4):
        for slope in slopes:
            across.append(_column_slope(rig, camera, grid, depth, math.tan(slope), 0.0)[0])
            down.append(_column_slope(rig, camera, grid, depth, 0.0, math.tan(slope))[1])
    x_slopes, y_slopes = np.concatenate(across), np.concatenate(down)
    x_slopes, y_slopes = x_slopes[np.isfinite(x_slopes)], y_slopes[np.isfinite(y_slopes)]
    if x_slopes.size == 0:
        return None
    sign = 1 if np.median(x_slopes) > 0 else -1
    low, middle, high = np.percentile(sign * x_slopes, [2, 50, 98]) * 2 * np.pi
    eta = np.percentile(sign * y_slopes, [1, 99]) * 2 * np.pi
    return FringeField((float(low), float(middle), float(high)), (float(eta[0]), float(eta[1])), sign)


def _column_slope(
    rig: Rig, camera: Device, pixels: FloatArray, depth: float, tilt_x: float, tilt_y: float
) -> tuple[FloatArray, FloatArray]:
    """du/dx and du/dy at pixels that see a plane through their own point at ``depth``, tilted by dz/dx, dz/dy."""
    assert rig.projector is not None
    rays = camera.undistort(pixels)
    columns = []
    for dx, dy in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        moved = camera.undistort(pixels + np.array([dx, dy]))
        # z = depth + tilt . (X - X0) along the moved ray, X = z * moved
        scale = (1 - tilt_x * rays[:, 0] - tilt_y * rays[:, 1]) / (1 - tilt_x * moved[:, 0] - tilt_y * moved[:, 1])
        points = np.column_stack([moved, np.ones(len(moved))]) * (depth * scale)[:, None]
        left_frame = (points - camera.translation) @ camera.rotation
        columns.append(rig.projector.project(left_frame)[:, 0])
    return columns[1] - columns[0], columns[2] - columns[0]


def carrier_bands(field: FringeField, periods: tuple[float, ...]) -> list[Band]:
    """One band a carrier, high first; where the carriers' ranges meet they are parted at the geometric mean."""
    low, middle, high = field.zeta
    bands = []
    for period in periods:
        zeta_low, zeta_high = low / period, min(high / period, 0.9 * math.pi)
        if len(periods) == 2:
            border = middle / math.sqrt(periods[0] * periods[1])
            zeta_low, zeta_high = (
                (max(zeta_low, border), zeta_high) if period == min(periods) else (zeta_low, min(zeta_high, border))
            )
        bands.append(Band((zeta_low, zeta_high), (field.eta[0] / period, field.eta[1] / period)))
    return bands


def spectral_field(image: npt.NDArray[np.float32], periods: tuple[float, ...]) -> FringeField:
    """The field read from the strongest carrier set of an image (H, W), for captures without calibration.

    Looks for the base frequency f at which the spectrum is strongest at f / period for all periods together. The sign
    cannot be seen in an image; +1 is assumed.
    """
    height, width = image.shape
    window = np.outer(np.hanning(height), np.hanning(width)).astype(np.float32)
    spectrum = np.abs(np.fft.rfft2((image - image.mean()) * window))
    rows = min(height // 2 - 1, max(2, height // 24))
    profile = np.concatenate([spectrum[:rows], spectrum[-rows:]]).max(axis=0)
    profile = profile * np.arange(len(profile)) ** 0.5
    frequency = 2 * np.pi * np.arange(len(profile)) / width
    lowest = 2 * np.pi * 2.5 / width * max(periods)
    candidates = np.geomspace(lowest, 0.8 * math.pi * min(periods), 2000)
    score = np.ones_like(candidates)
    for period in periods:
        score = score * np.interp(candidates / period, frequency, profile)
    base = float(candidates[score.argmax()])
    return FringeField((0.72 * base, base, 1.38 * base), (-0.28 * base, 0.28 * base), 1)
