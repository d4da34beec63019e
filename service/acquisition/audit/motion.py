"""Did the scene move between the composite and the phase steps?

The composite is half the sum of both carriers at their offset, mirror by mirror, so its image is the same sum of
images, whatever the scene, the lens and inter-reflections do. In each block of a row the recorded composite is fitted
by both fitted carriers and their quadratures: a phase against the prediction is motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from service.acquisition.audit.axes import Axis
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.rows import RowSample

BLOCK = 32
"""Pixels of a row in one block: a few fringes."""
LEAST_LIT_IN_BLOCK = 24
SIGNIFICANT = 5.0
"""Multiples of its own standard error from which a block's phase counts."""
LEAST_BLOCKS = 6


@dataclass(frozen=True)
class Motion:
    """blocks: how many were compared. moved: share of them that moved. typical: median of what was measured (phase in
    rad, or difference as a share of the level)."""

    blocks: int
    moved: float
    typical: float

    def is_motion(self, limits: AuditLimits) -> bool:
        return self.moved >= limits.moved_blocks and self.moved * self.blocks >= LEAST_BLOCKS


def measure_motion(
    sample: RowSample, axis: Axis, place: int, offsets: tuple[float, float], limits: AuditLimits
) -> Motion:
    """Compare the composite at ``place`` with the carriers of ``axis``; see ``Motion``."""
    high, low = axis.carriers
    members = np.concatenate([high.members, low.members, [place]])
    width = sample.lit.shape[1]
    blocks = width // BLOCK
    usable = (sample.lit & ~sample.saturated[members].any(axis=0))[:, : blocks * BLOCK].reshape(-1, BLOCK)
    keep = np.flatnonzero(usable.sum(axis=1) >= LEAST_LIT_IN_BLOCK)
    if not len(keep):
        return Motion(0, 0.0, 0.0)

    def cut(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.asarray(array[:, : blocks * BLOCK].reshape(-1, BLOCK)[keep] * usable[keep])

    mean = (sample.means[high.kind] + sample.means[low.kind]) / 2
    recorded = cut(sample.levels[place] - mean)
    columns = []
    for carrier, offset in zip((high, low), offsets, strict=True):
        wave = cut((sample.fields[carrier.kind] * np.exp(-1j * offset)).astype(np.complex64))
        columns += [wave.real, wave.imag]
    design = np.stack(columns, axis=2)
    normal = np.einsum("bpi,bpj->bij", design, design, optimize=True)
    normal += 1e-3 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(4) / 4
    target = np.einsum("bpi,bp->bi", design, recorded, optimize=True)
    inverse = np.linalg.inv(normal.astype(np.float64))
    fit = np.einsum("bij,bj->bi", inverse, target)
    rest = recorded - np.einsum("bpi,bi->bp", design, fit.astype(np.float32), optimize=True)
    variance = (rest**2).sum(axis=1) / (usable[keep].sum(axis=1) - 4)
    moved = np.zeros(len(keep), bool)
    largest = np.zeros(len(keep))
    for first in (0, 2):
        phase = np.abs(np.arctan2(fit[:, first + 1], fit[:, first]))
        amplitude = np.maximum(np.hypot(fit[:, first], fit[:, first + 1]), 0.05)
        error = np.sqrt(variance * np.maximum(inverse[:, first, first], inverse[:, first + 1, first + 1])) / amplitude
        moved |= (phase > limits.moved_phase) & (phase > SIGNIFICANT * error)
        largest = np.maximum(largest, phase)
    return Motion(len(keep), float(moved.mean()), float(np.median(largest)))
