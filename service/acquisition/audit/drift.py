"""Did the scene move between or during the groups of phase steps?

The mean over all steps of a carrier is the scene under even light, and so the same for each carrier. Where the means
of the first and the second differ by more than noise, something moved between them, whatever its direction.
"""

from __future__ import annotations

import numpy as np

from service.acquisition.audit.axes import Axis, Carrier, FloatArray
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.motion import BLOCK, Motion
from service.acquisition.audit.rows import RowSample, predict

THIN = 4
"""One column in so many serves to measure noise."""
LEAST_USABLE_IN_BLOCK = 24
LEAST_LIT_IN_BLOCK = 8
BEYOND_NOISE = 3.0


def measure_drift(sample: RowSample, axis: Axis, limits: AuditLimits) -> Motion | None:
    """Compare the means of the carriers of an axis in blocks of rows; None where there are not two carriers."""
    if len(axis.carriers) < 2 or min(len(c.members) for c in axis.carriers) <= 3:
        return None
    first, second = axis.carriers
    members = np.concatenate([first.members, second.members])
    width = sample.lit.shape[1] // BLOCK * BLOCK
    usable = (~sample.saturated[members].any(axis=0))[:, :width].reshape(-1, BLOCK)
    lit = sample.lit[:, :width].reshape(-1, BLOCK)
    keep = np.flatnonzero((usable.sum(axis=1) >= LEAST_USABLE_IN_BLOCK) & (lit.sum(axis=1) >= LEAST_LIT_IN_BLOCK))
    if not len(keep):
        return Motion(0, 0.0, 0.0)
    weight = usable[keep] / usable[keep].sum(axis=1, keepdims=True)

    def mean_square(values: FloatArray) -> FloatArray:
        return np.asarray((values[:, :width].reshape(-1, BLOCK)[keep] ** 2 * weight).sum(axis=1))

    means = [sample.means[c.kind] for c in axis.carriers]
    # The lamp may drift; a moving scene does not change its brightness everywhere by one factor.
    lamp = float(np.median(means[0][sample.lit] / means[1][sample.lit]))
    difference = mean_square(means[0] - np.float32(lamp) * means[1])
    level = mean_square((means[0] + means[1]) / 2)
    thin = [_mean_noise(sample, c)[:, : width // THIN].reshape(-1, BLOCK // THIN)[keep] for c in axis.carriers]
    noise = np.sum([variance.mean(axis=1) for variance in thin], axis=0)
    relative = np.sqrt(np.maximum(difference - noise, 0) / np.maximum(level, 1e-9))
    moved = (relative > limits.moved_level) & (difference > BEYOND_NOISE**2 * noise)
    return Motion(len(keep), float(moved.mean()), float(np.median(relative)))


def _mean_noise(sample: RowSample, carrier: Carrier) -> FloatArray:
    """Variance of a carrier's mean by what its fit leaves over, (rows, width / THIN)."""
    thin = (slice(None), slice(None, None, THIN))
    rest = sample.levels[carrier.members][(slice(None), *thin)] - predict(
        sample.means[carrier.kind][thin], sample.fields[carrier.kind][thin], carrier.angles
    )
    count = len(carrier.members)
    return np.asarray((rest**2).sum(axis=0) / ((count - 3) * count))
