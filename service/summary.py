"""What a reconstruction amounts to, in figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from models.points import Reason
from models.reconstruct import Reconstruction
from models.refiner.shipped import DEFAULT


@dataclass(frozen=True)
class WeightsUsed:
    """Of the refiner. name: of shipped weights or of the service's own, else the path given. variant: what they learned
    from. sha256: of the file of their numbers."""

    name: str
    variant: str
    sha256: str

    def __str__(self) -> str:
        return f"{self.name} ({self.variant}, sha256 {self.sha256[:12]})"


@dataclass(frozen=True)
class ReconstructionSummary:
    """points: number of valid pixels, and their share of all in per cent. z_mm: 1st, 50th and 99th percentile.

    reasons_percent: share of all pixels by reason of invalidity. timings_s: seconds per stage. weights: of the refiner.
    """

    method: str
    matching: str
    points: int
    valid_percent: float
    z_mm: tuple[float, float, float]
    depth_range_mm: tuple[float, float]
    reasons_percent: dict[str, float]
    timings_s: dict[str, float]
    weights: WeightsUsed | None = None

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    def __str__(self) -> str:
        near, middle, far = self.z_mm
        seconds = sum(self.timings_s.values())
        weights = "" if self.weights is None else f", weights {self.weights}"
        return (
            f"{self.points:,} points ({self.valid_percent:.1f} % of the pixels), z {near:.1f}..{far:.1f} mm "
            f"(median {middle:.1f}), {self.method}/{self.matching}{weights}, {seconds:.1f} s"
        )


def summarise(reconstruction: Reconstruction) -> ReconstructionSummary:
    """Figures of a reconstruction, which holds at least one point."""
    points = reconstruction.points
    near, middle, far = (float(z) for z in np.percentile(points.depth[points.valid], [1, 50, 99]))
    counts = np.bincount(points.mask.ravel(), minlength=len(Reason))
    reasons = {
        reason.name.lower(): round(100 * float(counts[reason]) / points.mask.size, 2)
        for reason in Reason
        if reason is not Reason.VALID
    }
    return ReconstructionSummary(
        method=reconstruction.options.method,
        matching=reconstruction.matching,
        points=len(points),
        valid_percent=round(100 * float(np.mean(points.valid)), 2),
        z_mm=(round(near, 3), round(middle, 3), round(far, 3)),
        depth_range_mm=(round(reconstruction.depth_range[0], 3), round(reconstruction.depth_range[1], 3)),
        reasons_percent=reasons,
        timings_s={stage: round(seconds, 3) for stage, seconds in reconstruction.timings_s.items()},
        weights=_weights_of(reconstruction),
    )


def _weights_of(reconstruction: Reconstruction) -> WeightsUsed | None:
    record = reconstruction.weights
    if record is None:
        return None
    return WeightsUsed(reconstruction.options.weights or DEFAULT, record.variant, record.sha256)
