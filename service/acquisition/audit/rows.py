"""Images thinned to rows: what the audit works on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from models.capture import Image
from models.errors import CaptureError
from models.patterns import PatternPlan
from service.acquisition.audit.axes import Axis, Carrier, ComplexArray, FloatArray
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.pieces import map_pixels

ROW_COUNTS = (48, 160)
"""Rows looked at first, and again where few of their pixels are lit; after that the whole image."""
ENOUGH_LIT = 1500


@dataclass(frozen=True, eq=False)
class RowSample:
    """A view on evenly spaced rows.

    raw: as recorded (exposures, rows, width). levels: float32, share of the white level. saturated: bool (exposures,
    rows, width). means, fields: fit of every carrier at every pixel, (rows, width). lit: bool (rows, width), every
    carrier is modulated. noise: rms of a reading at a dim lit pixel, share of the white level.
    """

    raw: npt.NDArray[np.integer]
    levels: FloatArray
    saturated: npt.NDArray[np.bool_]
    means: dict[str, FloatArray]
    fields: dict[str, ComplexArray]
    lit: npt.NDArray[np.bool_]
    noise: float

    @property
    def overexposed(self) -> npt.NDArray[np.bool_]:
        """At the white level in more frames than white and the bright planes explain, (rows, width)."""
        return np.asarray(self.saturated.mean(axis=0) > 0.6)


def fit_carrier(levels: FloatArray, angles: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Least-squares mean and complex field z of I_k = mean + Re(z exp(-i angle_k)); levels (n, ...)."""
    design = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    found = map_pixels(np.linalg.pinv(design).astype(np.float32), levels.reshape(len(levels), -1))
    mean, real, imaginary = found.reshape(3, *levels.shape[1:])
    return mean, real + 1j * imaginary


def predict(mean: FloatArray, field: ComplexArray, angles: FloatArray) -> FloatArray:
    """Levels (n, ...) of the fit at the given angles."""
    shape = (-1,) + (1,) * field.ndim
    cosine, sine = (f(angles).astype(np.float32).reshape(shape) for f in (np.cos, np.sin))
    return np.asarray(mean + cosine * field.real + sine * field.imag)


def sample_rows(
    images: Mapping[str, Image], plan: PatternPlan, axes: tuple[Axis, ...], white_level: int, limits: AuditLimits
) -> RowSample:
    """The view on as many rows as it takes to have enough lit pixels."""
    height = images[plan.names[0]].shape[0]
    for count in (*ROW_COUNTS, height):
        rows = np.unique(((np.arange(min(count, height)) + 0.5) * height / min(count, height)).astype(int))
        sample = _sample(images, plan, axes, rows, white_level, limits)
        if np.count_nonzero(sample.lit) >= ENOUGH_LIT:
            break
    return sample


def stack_rows(
    images: Mapping[str, Image], plan: PatternPlan, rows: npt.NDArray[np.integer]
) -> npt.NDArray[np.integer]:
    """Rows of every exposure as recorded, (exposures, rows, width). Raises CaptureError where an image is missing."""
    missing = [name for name in plan.names if name not in images]
    if missing:
        raise CaptureError(f"audit: image {missing[0]} of plan {plan.name} is missing; audit whole sequences only")
    shapes = {images[name].shape for name in plan.names}
    if len(shapes) > 1:
        raise CaptureError(f"audit: images of one view differ in size: {sorted(shapes)}")
    return np.stack([images[name][rows] for name in plan.names])


def _sample(
    images: Mapping[str, Image],
    plan: PatternPlan,
    axes: tuple[Axis, ...],
    rows: npt.NDArray[np.integer],
    white_level: int,
    limits: AuditLimits,
) -> RowSample:
    raw = stack_rows(images, plan, rows)
    levels = raw.astype(np.float32)
    levels *= np.float32(1 / white_level)
    means: dict[str, FloatArray] = {}
    fields: dict[str, ComplexArray] = {}
    lit = np.ones(raw.shape[1:], bool)
    noise = 0.0
    for carrier in (c for axis in axes for c in axis.carriers):
        stack = levels[carrier.members]
        mean, field = fit_carrier(stack, carrier.angles)
        threshold, noise = _lit_threshold(stack, mean, field, carrier, limits)
        lit &= field.real**2 + field.imag**2 >= threshold**2
        means[carrier.kind], fields[carrier.kind] = mean, field
    return RowSample(raw, levels, raw >= white_level, means, fields, lit, noise)


def _lit_threshold(
    stack: FloatArray, mean: FloatArray, field: ComplexArray, carrier: Carrier, limits: AuditLimits
) -> tuple[float, float]:
    """Amplitude from which a pixel is lit, and the noise of a reading, both as shares of the white level."""
    if carrier.steps <= 3 or len(carrier.members) <= 3:
        return limits.sure_modulation, 0.0
    thin = (slice(None, None, 4), slice(None, None, 16))
    rest = stack[(slice(None), *thin)] - predict(mean[thin], field[thin], carrier.angles)
    noise = float(np.sqrt(np.median((rest**2).sum(axis=0)) / (len(carrier.members) - 3)))
    # A wrong frame in the group looks like noise; it must not hide the scene.
    amplitude = 6 * noise * np.sqrt(2 / len(carrier.members))
    return float(np.clip(amplitude, limits.lit_modulation, limits.sure_modulation)), noise
