"""Small captures and reconstructions, made by hand, and libraries to keep them in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from models.capture import Capture, CaptureRecord, DeviceRecord, Truth
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import PatternPlan, make_pattern, make_plan
from models.phase.fringe import FringePhase
from models.points import Origin, PointMap, Reason
from models.reconstruct import Reconstruction, ReconstructionOptions
from service.library import Library, LibraryLimits

SHAPE = (24, 32)
LIMITS = LibraryLimits(minimum_free_bytes=0, idempotency_entries=50)


def open_library(root: Path, limits: LibraryLimits = LIMITS) -> Library:
    return Library.open(root, limits)


def make_capture(
    seed: int = 0,
    *,
    plan: PatternPlan | None = None,
    truth: bool = False,
    rig: Rig | None = None,
    shape: tuple[int, int] = SHAPE,
    dtype: type = np.uint8,
    views: int = 2,
    **record: object,
) -> Capture:
    """Noise under a plan of two patterns, or another."""
    draw = np.random.default_rng(seed)
    plan = plan or PatternPlan(name="short", patterns=(make_pattern("white"), make_pattern("composite")))
    sides: tuple[Side, ...] = SIDES[:views]
    images = {s: {name: draw.integers(0, 200, shape).astype(dtype) for name in plan.names} for s in sides}
    record = {
        "bit_depth": np.dtype(dtype).itemsize * 8,
        "devices": (DeviceRecord(role="left", driver="test"),),
    } | record
    plane = draw.random(shape, np.float32)
    return Capture(
        plan,
        images,
        rig,
        CaptureRecord.model_validate(record),
        Truth(plane, plane + 1, plane > 0.5, {"lit": plane > 0.2}) if truth else None,
    )


def same_captures(a: Capture, b: Capture) -> bool:
    """Whether plan, pixels, truth and calibration are the same."""
    same = a.plan == b.plan and a.sides == b.sides and a.rig == b.rig and (a.truth is None) == (b.truth is None)
    same &= all(np.array_equal(a.images[s][n], b.images[s][n]) for s in a.sides for n in a.plan.names)
    if a.truth is not None and b.truth is not None:
        same &= np.array_equal(a.truth.depth, b.truth.depth) and np.array_equal(a.truth.foreground, b.truth.foreground)
        same &= all(np.array_equal(a.truth.extra[name], b.truth.extra[name]) for name in a.truth.extra)
    return same


def make_points(seed: int = 0, shape: tuple[int, int] = SHAPE) -> PointMap:
    """A tilted plane with holes, and one valid pixel without a normal."""
    draw = np.random.default_rng(seed)
    valid = draw.random(shape) < 0.7
    v, u = np.mgrid[: shape[0], : shape[1]]
    z = 500 + 0.3 * u - 0.2 * v
    points = np.stack([(u - 16) * z / 1000, (v - 12) * z / 1000, z], axis=-1)
    points[~valid] = np.nan
    normals = np.where(valid[..., None], np.array([0.0, 0.6, -0.8]), np.nan)
    normals[tuple(np.argwhere(valid)[0])] = np.nan
    phase = np.where(valid, np.mod(z, 2 * np.pi), np.nan).astype(np.float32)
    return PointMap(
        points=points.astype(np.float32),
        normals=normals.astype(np.float32),
        confidence=np.where(valid, draw.random(shape), 0).astype(np.float32),
        intensity=draw.random(shape, np.float32),
        modulation=draw.random(shape, np.float32),
        phase_high=phase,
        phase_low=phase,
        origin=np.where(valid, Origin.LEFT_RIGHT, Origin.NONE).astype(np.uint8),
        mask=np.where(valid, Reason.VALID, Reason.NO_MATCH).astype(np.uint8),
    )


def make_reconstruction(rig: Rig, seed: int = 0, carriers: int = 2) -> Reconstruction:
    """A reconstruction of nothing in particular."""
    draw = np.random.default_rng(seed)

    def phase() -> FringePhase:
        angles = draw.uniform(-np.pi, np.pi, (carriers, *SHAPE)).astype(np.float32)
        return FringePhase(
            carriers=torch.polar(torch.full(angles.shape, 0.3), torch.from_numpy(angles)),
            texture=torch.zeros(SHAPE),
            mask=torch.from_numpy(np.where(draw.random(SHAPE) < 0.8, 0, 2).astype(np.uint8)),
            periods=(18.0, 91.2)[:carriers],
        )

    return Reconstruction(
        points=make_points(seed),
        phases={"left": phase(), "right": phase()},
        rig=rig,
        options=ReconstructionOptions(),
        depth_range=(400.0, 700.0),
        matching="stereo",
        timings_s={"phase": 0.1, "matching": 0.2, "points": 0.05},
    )


REFERENCE_PLAN = make_plan("reference")
