"""``reconstruction.json``: everything about a reconstruction except its arrays."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from models.geometry.rig import Side
from models.points import Origin
from models.reconstruct import Reconstruction
from service.library.phases import CARRIERS, Carrier
from service.summary import WeightsUsed, summarise

RECORD_NAME = "reconstruction.json"


class ReconstructionStatistics(BaseModel):
    """points: valid pixels, and their share of all in per cent. z_mm: 1st, 50th and 99th percentile.

    reasons_percent: share of all pixels by reason of invalidity. origins_percent: share of the points by the pair of
    devices that gave them. median_confidence: of the points, 0..1.
    """

    model_config = ConfigDict(frozen=True)

    points: int
    valid_percent: float
    z_mm: tuple[float, float, float]
    median_confidence: float
    reasons_percent: dict[str, float]
    origins_percent: dict[str, float]


class ReconstructionRecord(BaseModel):
    """What was made of which capture, how, and what came out. Unknown keys are kept.

    capture: id of the capture, which may have been deleted since. weights: of the method refiner, else None.
    depth_range: (min, max) mm. timings_s: seconds per stage. size: (width, height) of the left sensor's grid.
    phases: carriers by view. calibration: SHA-256 of the calibration used. software: version of this program.
    extra: what the caller added.
    """

    model_config = ConfigDict(extra="allow", populate_by_name=True, frozen=True)

    schema_: Literal["reconstruction/1"] = Field(default="reconstruction/1", alias="schema")
    id: str
    capture: str
    created: datetime
    method: str
    weights: WeightsUsed | None = None
    matching: str
    depth_range: tuple[float, float]
    timings_s: dict[str, float]
    size: tuple[int, int]
    phases: dict[Side, tuple[Carrier, ...]]
    statistics: ReconstructionStatistics
    calibration: str
    software: str
    extra: dict[str, Any] = {}

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


def record_of(
    reconstruction: Reconstruction,
    id: str,
    capture_id: str,
    extra: dict[str, Any],
) -> ReconstructionRecord:
    """The record of a reconstruction that has just been made."""
    points, summary = reconstruction.points, summarise(reconstruction)
    origins = np.bincount(points.origin[points.valid], minlength=len(Origin))
    height, width = points.shape
    return ReconstructionRecord(
        id=id,
        capture=capture_id,
        created=datetime.now(UTC),
        method=summary.method,
        weights=summary.weights,
        matching=summary.matching,
        depth_range=reconstruction.depth_range,
        timings_s=summary.timings_s,
        size=(width, height),
        phases={side: CARRIERS[: len(phase.periods)] for side, phase in reconstruction.phases.items()},
        statistics=ReconstructionStatistics(
            points=summary.points,
            valid_percent=summary.valid_percent,
            z_mm=summary.z_mm,
            median_confidence=round(float(np.median(points.confidence[points.valid])), 4),
            reasons_percent=summary.reasons_percent,
            origins_percent={
                origin.name.lower(): round(100 * float(origins[origin]) / summary.points, 2)
                for origin in Origin
                if origin is not Origin.NONE
            },
        ),
        calibration=hashlib.sha256(reconstruction.rig.fingerprint.encode("utf-8")).hexdigest(),
        software=_software(),
        extra=extra,
    )


@cache
def _software() -> str:
    try:
        return f"duofringe {version('duofringe')}"
    except PackageNotFoundError:  # run from a bare checkout
        return "duofringe"
