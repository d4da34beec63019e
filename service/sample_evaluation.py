"""Evaluation of one capture: every method asked for, and the yardsticks beside them, against one reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from models.capture import Capture, read_capture
from models.errors import CalibrationError, CaptureError, DatasetError, ReconstructionError
from models.geometry.rig import Rig
from models.metrics import Reference, SampleErrors, common_mask, compare
from models.patterns import PatternKind
from models.points import PointMap
from models.reconstruct import Method, ReconstructionOptions, reconstruct
from models.stereo.matcher import Matching

TruthSource = Literal["auto", "simulator", "reference"]
_GRAY: frozenset[PatternKind] = frozenset({"gray", "gray_inv"})
_STEPS: frozenset[PatternKind] = frozenset({"high", "low"})


@dataclass(frozen=True)
class EvaluationOptions:
    """What to evaluate. matchings: None stands for each capture's default. depth_range: mm, None for the calibration's.

    truth: "simulator" takes truth/, "reference" the capture's own N-step and Gray reconstruction (the paper's
    protocol), "auto" the first of these that a sample has.
    """

    methods: tuple[Method, ...]
    matchings: tuple[Matching | None, ...] = (None,)
    depth_range: tuple[float, float] | None = None
    truth: TruthSource = "auto"


@dataclass(frozen=True)
class SampleResult:
    """One sample: errors, stage timings (s) and reasons of failure by row of the tables."""

    sample: str
    object_id: str | None
    truth: TruthSource
    errors: Mapping[str, SampleErrors]
    timings_s: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, str]


def evaluate_sample(path: Path, options: EvaluationOptions, fallback_rig: Rig | None = None) -> SampleResult:
    """Every method and matching on one capture. fallback_rig: for captures without a calibration of their own."""
    capture = read_capture(path)
    rig = capture.rig or fallback_rig
    if rig is None:
        raise CalibrationError(f"{path}: has no calibration, and neither has the dataset")
    depth_range = options.depth_range or rig.working_depths
    asked = {
        _row(method, matching): ReconstructionOptions(method, matching, depth_range)
        for method in options.methods
        for matching in options.matchings
    }
    source, reference = _reference(capture, rig, options, depth_range)
    maps: dict[str, PointMap] = {}
    timings: dict[str, Mapping[str, float]] = {}
    failures: dict[str, str] = {}

    def run(row: str, of: Capture, choice: ReconstructionOptions) -> None:
        try:
            result = reconstruct(of, choice, rig=rig)
        except ReconstructionError as error:
            maps[row] = PointMap.empty(reference.depth.shape)
            failures[row] = str(error)
        else:
            maps[row] = result.points
            timings[row] = result.timings_s

    for row, choice in asked.items():
        run(row, capture, choice)
    common = common_mask(maps.values(), reference, depth_range)
    for row, (of, choice) in _yardsticks(capture, options, source, depth_range).items():
        if row not in maps:
            run(row, of, choice)
    period = _high_period(capture)
    errors = {row: compare(m, reference, rig, period, depth_range, common=common) for row, m in maps.items()}
    return SampleResult(path.name, capture.record.object_id, source, errors, timings, failures)


def _row(method: str, matching: Matching | None) -> str:
    return method if matching is None else f"{method} {matching}"


def _without_gray(capture: Capture) -> Capture:
    kept = (p.name for p in capture.plan.patterns if p.kind not in _GRAY)
    return replace(capture, plan=capture.plan.restricted_to(kept))


def _yardsticks(
    capture: Capture, options: EvaluationOptions, source: TruthSource, depth_range: tuple[float, float]
) -> dict[str, tuple[Capture, ReconstructionOptions]]:
    """Rows by which to judge the methods: perfect phases through the same matcher, and perfect orders."""
    rows: dict[str, tuple[Capture, ReconstructionOptions]] = {}
    if not capture.plan.kinds >= _STEPS:
        return rows
    for matching in options.matchings:
        choice = ReconstructionOptions("nstep", matching, depth_range)
        rows[_row("nstep wrapped", matching)] = (_without_gray(capture), choice)
    if "gray" in capture.plan.kinds and source != "reference":  # against itself it would tell nothing
        rows.setdefault(_row("nstep", options.matchings[0]), (capture, choice))
    return rows


def _high_period(capture: Capture) -> float:
    for kind in ("high", "composite"):
        patterns = capture.plan.of_kind(kind)
        if patterns:
            return patterns[0].periods[0]
    raise CaptureError(f"{capture.source}: has neither high nor composite images; nothing can be evaluated")


def _reference(
    capture: Capture, rig: Rig, options: EvaluationOptions, depth_range: tuple[float, float]
) -> tuple[TruthSource, Reference]:
    if options.truth != "reference" and capture.truth is not None:
        return "simulator", Reference.from_truth(capture.truth)
    if options.truth == "simulator":
        raise DatasetError(f"{capture.source}: has no truth/; use --truth reference or auto")
    if "gray" not in capture.plan.kinds:
        raise DatasetError(f"{capture.source}: has neither truth/ nor N-step and Gray images to compare with")
    own = reconstruct(capture, ReconstructionOptions("nstep", None, depth_range), rig=rig)
    return "reference", Reference.from_points(own.points, rig, _high_period(capture))
