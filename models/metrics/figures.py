"""From the sums of samples to the figures of the tables, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from models.metrics.histogram import quantile
from models.metrics.samples import SampleErrors

FloatArray = npt.NDArray[np.float64]
Interval = tuple[float, float]
_SUMS = tuple(f.name for f in fields(SampleErrors) if f.name != "histogram")


@dataclass(frozen=True)
class Figures:
    """Figures over all pixels of the samples; NaN where there is nothing to tell one from.

    samples, pixels: how many scenes, and how many GT-valid foreground pixels they have. valid, order_accuracy (FOAcc,
    tolerant), order_accuracy_literal, within_1mm, within_3mm: per cent of the foreground. mae_phase, rmse_phase: rad;
    mae_depth, rmse_depth, median_depth, p95_depth: mm; gross: per mille off by more than 3 mm; these over the method's
    valid pixels. common_mae_depth, common_rmse_depth: mm over the pixels valid in all methods, common_pixels of them.
    """

    samples: int
    pixels: int
    valid: float
    order_accuracy: float
    order_accuracy_literal: float
    mae_phase: float
    rmse_phase: float
    mae_depth: float
    rmse_depth: float
    within_1mm: float
    within_3mm: float
    common_pixels: int
    common_mae_depth: float
    common_rmse_depth: float
    p95_depth: float
    median_depth: float
    gross: float


_COUNTS = frozenset({"samples", "pixels", "common_pixels"})


@dataclass(frozen=True)
class Difference:
    """A figure of one method minus that of another, and the interval of it, low..high; NaN where there is none."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether the interval lies to one side of zero."""
        return self.low > 0 or self.high < 0


def aggregate(samples: Sequence[SampleErrors]) -> Figures:
    """Figures over all pixels of all samples; of one sample, with a sequence of one."""
    sums, histograms = _stack(samples)
    totals = {name: column.sum() for name, column in sums.items()}
    shares: dict[str, Any] = {n: float(value) for n, value in _shares(totals, histograms.sum(axis=0)).items()}
    pixels, common = int(totals["pixels"]), int(totals["common_pixels"])
    return Figures(samples=len(samples), pixels=pixels, common_pixels=common, **shares)


def bootstrap(
    samples: Sequence[SampleErrors], seed: int, *, resamples: int = 1000, confidence: float = 0.95
) -> dict[str, Interval]:
    """Percentile intervals of each figure (by field name of ``Figures``) over scenes drawn with replacement.

    Scenes, not pixels, are drawn: errors within a scene belong together. (NaN, NaN) for fewer than two scenes.
    """
    if len(samples) < 2:
        return {f.name: (np.nan, np.nan) for f in fields(Figures) if f.name not in _COUNTS}
    drawn = _resampled(samples, _draws(len(samples), seed, resamples))
    return {name: _interval(values, confidence) for name, values in drawn.items()}


def paired_bootstrap(
    samples: Sequence[SampleErrors],
    against: Sequence[SampleErrors],
    seed: int,
    *,
    resamples: int = 1000,
    confidence: float = 0.95,
) -> dict[str, Difference]:
    """How much each figure of ``samples`` is above that of ``against``, by field name of ``Figures``.

    Both are of the same scenes in the same order (ValueError otherwise), and each draw takes the same scenes for both:
    what makes a scene hard for either falls out of the difference. The intervals are as in ``bootstrap``.
    """
    if len(samples) != len(against):
        raise ValueError(f"{len(samples)} samples cannot be paired with {len(against)}")
    here, there = asdict(aggregate(samples)), asdict(aggregate(against))
    names = [name for name in here if name not in _COUNTS]
    if len(samples) < 2:
        return {name: Difference(here[name] - there[name], np.nan, np.nan) for name in names}
    draws = _draws(len(samples), seed, resamples)
    ours, theirs = _resampled(samples, draws), _resampled(against, draws)
    return {
        name: Difference(here[name] - there[name], *_interval(ours[name] - theirs[name], confidence)) for name in names
    }


def _draws(count: int, seed: int, resamples: int) -> FloatArray:
    """How often each scene is drawn, (resamples, count)."""
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), resamples)
    return drawn.astype(np.float64)


def _resampled(samples: Sequence[SampleErrors], draws: FloatArray) -> dict[str, FloatArray]:
    """Every figure of every draw, (resamples,) each."""
    sums, histograms = _stack(samples)
    return _shares({name: draws @ column for name, column in sums.items()}, draws @ histograms)


def _interval(values: FloatArray, confidence: float) -> Interval:
    known = values[np.isfinite(values)]
    if known.size == 0:
        return np.nan, np.nan
    low, high = np.quantile(known, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


def _stack(samples: Sequence[SampleErrors]) -> tuple[dict[str, FloatArray], FloatArray]:
    """Each sum as a column (samples,), and the histograms (samples, bins)."""
    sums = {name: np.array([getattr(s, name) for s in samples], np.float64) for name in _SUMS}
    if not samples:
        return sums, np.zeros((0, 1))
    return sums, np.stack([s.histogram for s in samples]).astype(np.float64)


def _shares(sums: dict[str, FloatArray], histograms: FloatArray) -> dict[str, FloatArray]:
    """Every figure of sums (...) and histograms (..., bins)."""

    def per(part: str, whole: str) -> FloatArray:
        known = sums[whole] > 0
        return np.divide(sums[part], sums[whole], out=np.full_like(sums[whole], np.nan), where=known)

    return {
        "valid": 100 * per("valid", "pixels"),
        "order_accuracy": 100 * per("order_tolerant", "judged"),
        "order_accuracy_literal": 100 * per("order_literal", "judged"),
        "mae_phase": per("phase_absolute", "phase_pixels"),
        "rmse_phase": np.sqrt(per("phase_square", "phase_pixels")),
        "mae_depth": per("depth_absolute", "valid"),
        "rmse_depth": np.sqrt(per("depth_square", "valid")),
        "within_1mm": 100 * per("within_1mm", "pixels"),
        "within_3mm": 100 * per("within_3mm", "pixels"),
        "common_mae_depth": per("common_absolute", "common_pixels"),
        "common_rmse_depth": np.sqrt(per("common_square", "common_pixels")),
        "p95_depth": quantile(histograms, 0.95),
        "median_depth": quantile(histograms, 0.5),
        "gross": 1000 * per("beyond_3mm", "valid"),
    }
