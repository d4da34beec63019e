"""Small captures to replay."""

from __future__ import annotations

import zlib
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from models.capture import Capture, CaptureRecord, DeviceRecord, Image, Truth, write_capture
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import PatternPlan, make_plan

PLAN = make_plan("full").restricted_to(["white", "composite", "black"])
SHAPE = (24, 32)


def recorded_image(name: str, side: Side, pattern: str, bits: int = 8) -> Image:
    """Noise that is the capture's, the side's and the pattern's own."""
    rng = np.random.default_rng(zlib.crc32(f"{name}/{side}/{pattern}".encode()))
    return rng.integers(0, 2**bits, SHAPE).astype(np.uint8 if bits == 8 else np.uint16)


def write(
    folder: Path,
    name: str,
    plan: PatternPlan = PLAN,
    *,
    sides: tuple[Side, ...] = SIDES,
    bits: int = 8,
    rig: Rig | None = None,
    truth: Truth | None = None,
) -> Path:
    """A capture folder of random images."""
    roles = ("left", "right", "projector") if len(sides) == 2 else ("left", "projector")
    devices = tuple(
        DeviceRecord.model_validate(
            {"role": role, "driver": "aravis", "model": f"GS3 {role}", "serial": f"{role}-77", "firmware": "2.1"}
        )
        for role in roles
    )
    record = CaptureRecord(
        id=f"id of {name}",
        created=datetime(2024, 5, 6, tzinfo=UTC),
        devices=devices,
        settings={"exposure_us": 8333.0},
        warnings=("left: dusty",),
        object_id="vase",
        bit_depth=bits,
        white_level=2**bits - 1,
    )
    images = {s: {p.name: recorded_image(name, s, p.name, bits) for p in plan.patterns} for s in sides}
    write_capture(Capture(plan, images, rig, record, truth), folder / name)
    return folder / name
