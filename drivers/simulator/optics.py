"""Projector and lens optics: what a pattern looks like once it has left the mirrors, and the cameras' blur."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from models.geometry.device import Device
from models.geometry.projection import pack_projection, project_point
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
    gamma: exponent of the projector's response; a DMD that shows bit planes is linear, 1.
    """

    footprint: int = 2
    psf_px: float = 0.4
    defocus_columns: float = 0.7
    contrast: float = 600.0
    gamma: float = 1.0


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
    centres = mirror_centres(raster, row_coded=pattern.is_row_coded)
    values = pattern.evaluate(0.0, centres) if pattern.is_row_coded else pattern.evaluate(centres)
    levels = np.rint(np.clip(values, 0, 255))
    return profile_of(levels, raster, optics, rows_per_column, row_coded=pattern.is_row_coded)


def mirror_centres(raster: Raster, *, row_coded: bool) -> npt.NDArray[np.float64]:
    """Where mirrors have their centres along v, or along u: on the diamond raster twice a column."""
    if row_coded:
        return np.arange(raster.rows, dtype=np.float64)
    per_column = 2 if raster.kind == "diamond" else 1
    return np.arange(per_column * raster.columns, dtype=np.float64) / per_column


def profile_of(
    levels: npt.NDArray[Any], raster: Raster, optics: Optics, rows_per_column: float, *, row_coded: bool
) -> Profile:
    """The light that leaves mirrors with ``levels``, 0..255, at each of ``mirror_centres``."""
    diamond = raster.kind == "diamond"
    pitch = 0.5 if diamond and not row_coded else 1.0
    sigma = optics.defocus_columns * (rows_per_column if row_coded else 1.0)
    count = len(levels)
    light = light_share(levels, optics)
    steps = round(PROFILE_STEPS * pitch)
    extent = _MARGIN + 6 * sigma
    margin = int(np.ceil(extent / pitch))
    impulses = np.zeros((count + 2 * margin) * steps)
    impulses[margin * steps :: steps][:count] = light
    kernel = _mirror_kernel(steps, sigma * PROFILE_STEPS, triangle=diamond)
    blurred = np.convolve(impulses, kernel, mode="same")
    return Profile(blurred.astype(np.float32), -margin * pitch, row_coded)


def light_share(levels: npt.NDArray[Any], optics: Optics) -> npt.NDArray[np.float64]:
    """Share of full white that leaves a mirror at ``levels``, 0..255: black is not quite dark."""
    leak = 1.0 / optics.contrast
    return np.asarray((levels / 255) ** optics.gamma * (1 - leak) + leak, np.float64)


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


def gather(gain: Float32Array, coordinate: Float32Array, profile: Profile, base: Float32Array) -> Float32Array:
    """Light (H, W): ``base`` plus the mean over S samples of ``gain`` times the profile at ``coordinate`` (H, W, S)."""
    samples = gain.shape[-1]
    out = np.empty(base.shape, np.float32)
    _gather(
        gain.reshape(-1, samples),
        coordinate.reshape(-1, samples),
        profile.light,
        np.float32(profile.start),
        base.ravel(),
        out.ravel(),
    )
    return out


@compiled
def _gather(gain: Any, coordinate: Any, light: Any, start: Any, base: Any, out: Any) -> None:
    last = len(light) - 2
    samples = gain.shape[1]
    share = np.float32(1.0 / samples)
    for i in range(len(gain)):
        total = np.float32(0.0)
        for s in range(samples):
            weight = gain[i, s]
            if weight > 0:
                position = (coordinate[i, s] - start) * np.float32(PROFILE_STEPS)
                cell = min(max(int(position), 0), last)
                part = position - np.float32(cell)
                total += weight * (light[cell] + part * (light[cell + 1] - light[cell]))
        out[i] = base[i] + total * share


def footprint_offsets(footprint: int) -> npt.NDArray[np.float64]:
    """Sub-sample positions (footprint^2, 2) within a pixel, (x, y) relative to its centre, pixels."""
    along = (np.arange(footprint) + 0.5) / footprint - 0.5
    y, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1)


def blur_image(image: Float32Array, psf_px: float) -> Float32Array:
    """The lens's Gaussian blur, edges reflected."""
    if psf_px <= 0:
        return image
    kernel = _discrete_gaussian(psf_px)
    blurred = cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred, np.float32)


@lru_cache(maxsize=4)
def _discrete_gaussian(sigma: float) -> npt.NDArray[np.float64]:
    """Kernel of variance sigma^2 exactly, which samples of a narrow Gaussian lack (Lindeberg, PAMI 1990, 12(3))."""
    reach = int(np.ceil(5 * sigma)) + 1
    angle = 2 * np.pi * np.arange(512) / 512
    transfer = np.exp(sigma**2 * (np.cos(angle) - 1))
    return np.asarray((transfer * np.cos(np.arange(-reach, reach + 1)[:, None] * angle)).mean(axis=1))


def project_points(device: Device, points: npt.NDArray[np.floating]) -> Float32Array:
    """``Device.project`` for millions of points: pixels or mirrors, float32 (N, 2), of left-frame points (N, 3)."""
    out = np.empty((len(points), 2), np.float32)
    _project(pack_projection(device), np.ascontiguousarray(points, np.float64), out)
    return out


@compiled
def _project(device: Any, points: Any, out: Any) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if device[6] * x + device[7] * y + device[8] * z + device[11] > 1e-9:
            out[i, 0], out[i, 1] = project_point(device, x, y, z)
        else:
            out[i, 0] = np.nan
            out[i, 1] = np.nan
