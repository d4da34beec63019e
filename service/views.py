"""Captures and reconstructions as the API shows them."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Any

from pydantic import BaseModel, Field

from models.geometry.rig import Side
from service.library import StoredCapture, StoredReconstruction
from service.library.reconstruction_record import ReconstructionStatistics
from service.summary import WeightsUsed

_LINK_NAMES = re.compile(r"[./]")


class CaptureView(BaseModel):
    """A stored capture; ``images`` by side and pattern are links to PNGs."""

    id: str
    created: datetime
    plan: str
    patterns: list[str]
    sides: list[Side]
    size: tuple[int, int] | None = Field(description="(width, height) px")
    bit_depth: int | None
    object_id: str | None
    replayed: bool = Field(description="Made from a recorded capture: its images are older than its date.")
    simulated: bool
    devices: list[dict[str, Any]]
    settings: dict[str, Any]
    warnings: list[str]
    has_calibration: bool
    has_truth: bool
    bytes: int
    damaged: str | None = Field(None, description="What is wrong with its folder, if anything.")
    extra: dict[str, Any] = Field({}, description="Notes, scene, attempts and whatever else its record holds.")
    links: dict[str, str]

    @classmethod
    def of(cls, stored: StoredCapture) -> CaptureView:
        here = f"/v1/captures/{stored.id}"
        origins = {device.origin for device in stored.devices}
        images = {
            f"image_{side}_{name}": f"{here}/images/{side}/{name}.png"
            for side in stored.sides
            for name in stored.patterns
        }
        return cls(
            id=stored.id,
            created=stored.created,
            plan=stored.plan,
            patterns=list(stored.patterns),
            sides=list(stored.sides),
            size=stored.size,
            bit_depth=stored.bit_depth,
            object_id=stored.object_id,
            replayed="replayed" in origins,
            simulated="simulated" in origins,
            devices=[device.model_dump(mode="json") for device in stored.devices],
            settings=stored.settings,
            warnings=list(stored.warnings),
            has_calibration=stored.has_calibration,
            has_truth=stored.has_truth,
            bytes=stored.bytes_on_disk,
            damaged=stored.damaged,
            extra=stored.extra,
            links={"self": here, "archive": f"{here}/archive.zip", **images},
        )


class ReconstructionView(BaseModel):
    """A stored reconstruction; what a damaged one no longer tells is null.

    timings_s: seconds per stage. statistics: shares in per cent, depths (1st, 50th, 99th percentile) in mm.
    """

    id: str
    created: datetime
    capture: str | None = None
    method: str | None = Field(None, description="The one used, whether asked for or chosen.", examples=["refiner"])
    weights: WeightsUsed | None = Field(None, description="Of the method refiner.")
    matching: str | None = None
    depth_range_mm: tuple[float, float] | None = None
    size: tuple[int, int] | None = Field(None, description="(width, height) of the point map")
    timings_s: dict[str, float] = {}
    statistics: ReconstructionStatistics | None = None
    calibration: str | None = Field(None, description="SHA-256 of the calibration used, as /v1/rig gives it.")
    software: str | None = None
    warnings: list[str] = []
    bytes: int
    damaged: str | None = Field(None, description="What is wrong with its folder, if anything.")
    links: dict[str, str]

    @classmethod
    def of(cls, stored: StoredReconstruction) -> ReconstructionView:
        here = f"/v1/reconstructions/{stored.id}"
        links = {"self": here}
        record = stored.record
        if record is None:
            return cls(
                id=stored.id, created=stored.created, bytes=stored.bytes_on_disk, damaged=stored.damaged, links=links
            )
        links |= {_LINK_NAMES.sub("_", name.removeprefix("points.")): f"{here}/{name}" for name in stored.artefacts}
        return cls(
            id=stored.id,
            created=stored.created,
            capture=record.capture,
            method=record.method,
            weights=record.weights,
            matching=record.matching,
            depth_range_mm=record.depth_range,
            size=record.size,
            timings_s=record.timings_s,
            statistics=record.statistics,
            calibration=record.calibration,
            software=record.software,
            warnings=record.extra.get("warnings", []),
            bytes=stored.bytes_on_disk,
            damaged=stored.damaged,
            links={**links, "capture": f"/v1/captures/{record.capture}", "report": f"{here}/report"},
        )


class Clocks(BaseModel):
    """Seconds from the request's start, on the service's clock.

    acquisition: until the last exposure was over, when the scene may move. result: until the cloud was ready.
    """

    acquisition_s: float
    result_s: float | None = None


class CaptureAnswer(CaptureView):
    """A capture just taken. timings_s: seconds per step. attempts: 1 unless frames had to be taken again."""

    attempts: int
    timings_s: dict[str, float]
    clocks: Clocks


class CaptureAndReconstructionAnswer(BaseModel):
    """One exposure to one cloud. timings_s: ``capture``, ``store`` (beside the reconstruction), ``reconstruction`` with
    its parts, ``total``; ``total`` less capture and reconstruction is what the service itself took."""

    capture: CaptureView
    reconstruction: ReconstructionView
    attempts: int
    timings_s: dict[str, float]
    clocks: Clocks
    links: dict[str, str]


class Page(BaseModel):
    """A part of a list. next: cursor of the part that follows, null at the end."""

    next: str | None = None


class CapturePage(Page):
    items: list[CaptureView]


class ReconstructionPage(Page):
    items: list[ReconstructionView]
