"""Projector and lens optics: what a pattern looks like once it has left the mirrors, and the cameras' blur."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from models.geometry.device import Device
from models.patterns import Pattern, Raster

Float32Array = npt.NDArray[np.float32]
PROFILE_STEPS = 32
"""Samples of a pattern profile per mirror; linear interpolation between them errs by under 0.02 grey levels."""
_MARGIN = 8


@dataclass(frozen=True)
class Optics:
    """Settings of the lenses.

    footprint: sub-samples along each side of a camera pixel. psf_px: sigma of the cameras' blur, pixels.
    defocus_columns: sigma of the projector's blur on the DMD, columns. contrast: white over black of the projector.
    """

    footprint: int = 2
    psf_px: float = 0.4
    defocus_columns: float = 0.7
    contrast: float = 600.0


@dataclass(frozen=True, eq=False)
class Profile:
    """Light of a one-dimensional pattern along u (or v): share of full white at ``start + i / PROFILE_STEPS``."""

    light: Float32Array
    start: float
    row_coded: bool


def pattern_profile(pattern: Pattern, raster: Raster, optics: Optics, rows_per_column: float = 1.0) -> Profile:
    """The light that leaves the projector for one pattern, after 8-bit values, mirror shape and defocus.

    rows_per_column: column pitch over row pitch of the DMD (2 on the diamond raster).
    A square mirror is a box one mirror wide. A diamond mirror, seen along u or v, is a triangle that ends where its
    neighbour of the next row has its centre, half a column or one row away; the defocus blends these rows into one
    another (their beat, one cycle a column pitch, keeps under 1e-4 of its contrast at 0.7 columns).
    """
    diamond = raster.kind == "diamond"
    if pattern.is_row_coded:
        count, pitch = raster.rows, 1.0
        sigma = optics.defocus_columns * rows_per_column
    else:
        count, pitch = (2 * raster.columns, 0.5) if diamond else (raster.columns, 1.0)
        sigma = optics.defocus_columns
    centres = np.arange(count) * pitch
    values = pattern.evaluate(0.0, centres) if pattern.is_row_coded else pattern.evaluate(centres)
    leak = 1.0 / optics.contrast
    light = np.rint(np.clip(values, 0, 255)) / 255 * (1 - leak) + leak
    steps = round(PROFILE_STEPS * pitch)
    extent = _MARGIN + 6 * sigma
    margin = int(np.ceil(extent / pitch))
    impulses = np.zeros((count + 2 * margin) * steps)
    impulses[margin * steps :: steps][:count] = light
    kernel = _mirror_kernel(steps, sigma * PROFILE_STEPS, triangle=diamond)
    blurred = np.convolve(impulses, kernel, mode="same")
    return Profile(blurred.astype(np.float32), -margin * pitch, pattern.is_row_coded)


def _mirror_kernel(steps: int, sigma: float, *, triangle: bool) -> npt.NDArray[np.float64]:
    """Mirror aperture and Gaussian blur, sampled; shifted copies ``steps`` apart add up to one everywhere."""
    box = np.ones(steps + 1)
    box[[0, -1]] = 0.5  # an odd length keeps the box centred; its halves meet the neighbours' halves
    box /= steps
    aperture = np.convolve(box, box) if triangle else box
    reach = int(np.ceil(5 * sigma))
    blur = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2) if sigma > 0 else np.ones(1)
    kernel = np.convolve(aperture, blur / blur.sum())
    return np.asarray(kernel * steps, np.float64)


def footprint_offsets(footprint: int) -> npt.NDArray[np.float64]:
    """Sub-sample positions (footprint^2, 2) within a pixel, (x, y) relative to its centre, pixels."""
    along = (np.arange(footprint) + 0.5) / footprint - 0.5
    y, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1)


def blur_image(image: Float32Array, psf_px: float) -> Float32Array:
    """The lens's Gaussian blur, edges reflected."""
    if psf_px <= 0:
        return image
    reach = 2 * int(np.ceil(3 * psf_px)) + 1
    blurred = cv2.GaussianBlur(image, (reach, reach), psf_px, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred, np.float32)


def project_points(device: Device, points: npt.NDArray[np.floating]) -> Float32Array:
    """Pixels or mirrors, float32 (N, 2), of left-frame points (N, 3); NaN behind the device.

    The same as ``Device.project``, which it calls for tilted sensors, but several times faster for millions of points.
    """
    coefficients = np.zeros(14)
    coefficients[: device.distortion.size] = device.distortion
    if coefficients[12:].any():
        return np.asarray(device.project(points), np.float32)
    out = np.empty((len(points), 2), np.float32)
    _project(
        np.ascontiguousarray(points, np.float64), device.rotation, device.translation, device.matrix, coefficients, out
    )
    return out


@compiled
def _project(points: Any, rotation: Any, translation: Any, matrix: Any, d: Any, out: Any) -> None:
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + translation[2]
        if not z > 1e-9:
            out[i, 0] = np.nan
            out[i, 1] = np.nan
            continue
        x = (rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + translation[0]) / z
        y = (rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + translation[1]) / z
        r2 = x * x + y * y
        radial = (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))) / (1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7])))
        xd = x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x) + r2 * (d[8] + r2 * d[9])
        yd = y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y + r2 * (d[10] + r2 * d[11])
        out[i, 0] = matrix[0, 0] * xd + matrix[0, 1] * yd + matrix[0, 2]
        out[i, 1] = matrix[1, 1] * yd + matrix[1, 2]
