"""Absolute depth errors counted in fine bins, so that medians of a whole split need no pixel of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_EDGES = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 4096)])
BINS = len(_EDGES)
"""One from 0 to 0.1 micrometres, then logarithmic ones 0.45 % wide, and one for all beyond 10 m."""


def count(errors: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Histogram (BINS,) of absolute errors (n,), mm."""
    return np.bincount(np.searchsorted(_EDGES, errors, side="right") - 1, minlength=BINS)


def quantile(histograms: npt.NDArray[np.float64], share: float) -> npt.NDArray[np.float64]:
    """Error (...) below which the share lies, mm, of histograms (..., BINS); linear in a bin, NaN for empty ones."""
    cumulative = np.cumsum(histograms, axis=-1)
    total = cumulative[..., -1]
    target = share * total
    at = np.minimum((cumulative < target[..., None]).sum(axis=-1), BINS - 1)
    inside = np.take_along_axis(histograms, at[..., None], axis=-1)[..., 0]
    before = np.take_along_axis(cumulative, at[..., None], axis=-1)[..., 0] - inside
    part = np.divide(target - before, inside, out=np.zeros_like(total), where=inside > 0)
    lower, upper = _EDGES[at], _EDGES[np.minimum(at + 1, BINS - 1)]
    return np.where(total > 0, lower + part * (upper - lower), np.nan)
