"""A composite on its own: are both carriers there?

Each stretch of a row is laid against a set of frequency pairs in the ratio of the two periods, whatever the camera
makes of their size. A stretch shows both carriers where one pair explains it far better than either frequency alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from service.acquisition.audit.axes import FloatArray
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.pieces import map_pixels_transposed

STRETCHES = ((96, 4.0, 26.0), (256, 2.5, 11.0), (768, 2.5, 7.5))
"""Lengths tried, px, and how few and many cycles of the low carrier each may hold: fringes of 4 to 300 px."""
NOISE_MULTIPLE = 3.0
LEAST_CONTRAST = 1.5 / 255
LEAST_STRETCHES = 6
BOTH = 0.12
"""Share of a stretch's energy that each of the two carriers must add to what the other explains."""
MOST_STRETCHES = 600


@dataclass(frozen=True)
class TwoCarriers:
    """stretches: how many had contrast. both: share of them that show both carriers. level: mean of the image."""

    stretches: int
    both: float
    level: float
    contrast: float


def find_two_carriers(
    image: FloatArray, saturated: npt.NDArray[np.bool_], ratio: float, limits: AuditLimits
) -> TwoCarriers:
    """Look for both carriers in rows of a composite.

    image: (rows, width), share of the white level. ratio: low period over high period.
    """
    best = TwoCarriers(0, 0.0, float(image.mean()), 0.0)
    for length, fewest, most in STRETCHES:
        if image.shape[1] < length:
            break
        found = _stretch_test(image, saturated, _probes(length, ratio, fewest, most), limits)
        if found.both >= best.both or not best.stretches:
            best = found
        if best.both >= limits.two_carriers and best.stretches >= LEAST_STRETCHES:
            break
    return best


def _stretch_test(
    image: FloatArray,
    saturated: npt.NDArray[np.bool_],
    probes: tuple[FloatArray, FloatArray, FloatArray],
    limits: AuditLimits,
) -> TwoCarriers:
    trend, window, pairs = probes
    length = len(window)
    starts = np.arange(0, image.shape[1] - length + 1, length // 2)
    cut = np.stack([image[:, s : s + length] for s in starts], axis=1).reshape(-1, length)
    clipped = np.stack([saturated[:, s : s + length].mean(axis=1) for s in starts], axis=1).ravel()
    # Third differences pass noise and hold back fringes; the quietest quarter of the view is dark or plain.
    noise = float(np.percentile(np.diff(cut[::4], n=3).std(axis=1), 25) / np.sqrt(20))
    threshold = float(np.clip(NOISE_MULTIPLE * noise, LEAST_CONTRAST, limits.composite_contrast))
    trends = map_pixels_transposed(cut.T, trend.T)
    cut = (cut - map_pixels_transposed(trends.T, trend)) * window
    energy = (cut**2).sum(axis=1)
    contrast = np.sqrt(energy / (window**2).sum())
    keep = np.flatnonzero((contrast > threshold) & (clipped < 0.1))
    level = float(image.mean())
    if not len(keep):
        return TwoCarriers(0, 0.0, level, float(np.percentile(contrast, 99)))
    keep = keep[:: max(1, len(keep) // MOST_STRETCHES)]
    response = map_pixels_transposed(cut[keep].T, pairs).reshape(len(keep), 2, 3, -1) ** 2
    low, high, between = response.sum(axis=1).transpose(1, 0, 2) / energy[keep, None]
    ridge = np.minimum(low, high) - between
    return TwoCarriers(len(keep), float((ridge.max(axis=1) > BOTH).mean()), level, float(np.median(contrast[keep])))


@lru_cache(maxsize=8)
def _probes(length: int, ratio: float, fewest: float, most: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Trend basis (3, length), window (length,), and probes (length, 6 n): cosines, then sines, of low, high, between.

    The squared response of a probe to a cosine of its frequency is that cosine's share of the energy.
    """
    x = np.linspace(-1, 1, length)
    trend = np.linalg.qr(np.stack([np.ones(length), x, x**2], axis=1))[0].T
    window = np.hanning(length + 2)[1:-1]
    low = np.geomspace(fewest, min(most, 0.45 * length / ratio), 72) / length
    frequencies = np.concatenate([low, low * ratio, low * np.sqrt(ratio)])
    angles = 2 * np.pi * np.outer(np.arange(length), frequencies)
    probes = np.concatenate([np.cos(angles), np.sin(angles)], axis=1) * window[:, None]
    probes *= np.sqrt(2.0 / (window**2).sum())
    return trend.astype(np.float32), window.astype(np.float32), probes.astype(np.float32)
