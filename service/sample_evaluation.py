"""Evaluation of one capture: every method asked for, and the yardsticks beside them, against one reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from models.capture import Capture, read_capture
from models.errors import CalibrationError, CaptureError, DatasetError, ReconstructionError
from models.geometry.rig import Rig
from models.metrics import Reference, SampleErrors, common_mask, compare, near_edges, traits_of
from models.patterns import PatternKind
from models.points import PointMap
from models.reconstruct import METHODS, Method, ReconstructionOptions, reconstruct
from models.stereo.matcher import Matching
from service.evaluation_pictures import Drawing, DrawnRow, write_evaluation_picture

TruthSource = Literal["auto", "simulator", "reference"]
_GRAY: frozenset[PatternKind] = frozenset({"gray", "gray_inv"})
_STEPS: frozenset[PatternKind] = frozenset({"high", "low"})
_LEARNED = frozenset({"refiner"})


@dataclass(frozen=True)
class MethodChoice:
    """A method and, for one that has learned, which weights it takes; None for its default ones."""

    method: Method
    weights: str | None = None

    @property
    def label(self) -> str:
        """What it is called in tables, METHOD or METHOD:WEIGHTS; ``parse`` reads it."""
        return self.method if self.weights is None else f"{self.method}:{self.weights}"

    @classmethod
    def parse(cls, text: str) -> MethodChoice:
        """METHOD or METHOD:WEIGHTS; raises ReconstructionError for an unknown method or weights it cannot take."""
        name, colon, weights = text.strip().partition(":")
        method = next((known for known in METHODS if known == name), None)
        if method is None:
            raise ReconstructionError(f"'{name}' is not one of {', '.join(METHODS)}")
        if not colon:
            return cls(method)
        if method not in _LEARNED:
            raise ReconstructionError(f"'{text.strip()}': method {method} has no weights; write {method}")
        if not weights:
            raise ReconstructionError(f"'{text.strip()}': weights are missing; write {method} or {method}:WEIGHTS")
        return cls(method, weights)


@dataclass(frozen=True)
class EvaluationOptions:
    """What to evaluate. matchings: None stands for each capture's default. depth_range: mm, None for the calibration's.

    truth: "simulator" takes truth/, "reference" the capture's own N-step and Gray reconstruction (the paper's
    protocol), "auto" the first of these that a sample has. pictures: folder for one PNG of each sample in
    ``pictured``, by name.
    """

    methods: tuple[MethodChoice, ...]
    matchings: tuple[Matching | None, ...] = (None,)
    depth_range: tuple[float, float] | None = None
    truth: TruthSource = "auto"
    pictures: Path | None = None
    pictured: frozenset[str] = frozenset()

    @property
    def rows(self) -> tuple[str, ...]:
        """Labels of the rows that are asked for, and of the yardsticks that samples with N-step images add."""
        asked = [_row(choice.label, matching) for choice in self.methods for matching in self.matchings]
        yardsticks = [_row("nstep wrapped", matching) for matching in self.matchings]
        return tuple(dict.fromkeys([*asked, *yardsticks, _row("nstep", self.matchings[0])]))


@dataclass(frozen=True)
class SampleResult:
    """One sample: errors, stage timings (s) and reasons of failure by row of the tables.

    regions: errors by region of the image and row; those of all regions add up to ``errors``. traits: what the scene
    was made to contain, None where the capture does not tell.
    """

    sample: str
    object_id: str | None
    truth: TruthSource
    errors: Mapping[str, SampleErrors]
    timings_s: Mapping[str, Mapping[str, float]]
    failures: Mapping[str, str]
    regions: Mapping[str, Mapping[str, SampleErrors]] = field(default_factory=dict)
    traits: frozenset[str] | None = None


def evaluate_sample(path: Path, options: EvaluationOptions, fallback_rig: Rig | None = None) -> SampleResult:
    """Every method and matching on one capture. fallback_rig: for captures without a calibration of their own."""
    capture = read_capture(path)
    rig = capture.rig or fallback_rig
    if rig is None:
        raise CalibrationError(f"{path}: has no calibration, and neither has the dataset")
    depth_range = options.depth_range or rig.working_depths
    asked = {
        _row(choice.label, matching): _reconstruction(choice, matching, depth_range)
        for choice in options.methods
        for matching in options.matchings
    }
    source, reference = _reference(capture, rig, options, depth_range)
    maps: dict[str, PointMap] = {}
    timings: dict[str, Mapping[str, float]] = {}
    failures: dict[str, str] = {}
    drawn: dict[str, DrawnRow] = {}
    pictured = options.pictures is not None and path.name in options.pictured

    def run(row: str, of: Capture, choice: ReconstructionOptions) -> None:
        try:
            result = reconstruct(of, choice, rig=rig)
        except ReconstructionError as error:
            maps[row] = PointMap.empty(reference.depth.shape)
            failures[row] = str(error)
        else:
            maps[row] = result.points
            timings[row] = result.timings_s
            if pictured:
                drawn[row] = DrawnRow.of(result)

    for row, choice in asked.items():
        run(row, capture, choice)
    common = common_mask(maps.values(), reference, depth_range)
    for row, (of, choice) in _yardsticks(capture, options, source, depth_range).items():
        if row not in maps:
            run(row, of, choice)
    period = _high_period(capture)

    def errors_of(part: Reference) -> dict[str, SampleErrors]:
        return {row: compare(m, part, rig, period, depth_range, common=common) for row, m in maps.items()}

    band = near_edges(reference.depth)
    regions = {"boundaries": band, "interior": ~band}
    errors = errors_of(reference)
    if pictured and options.pictures is not None:
        drawing = Drawing(capture, reference, band, period, depth_range)
        write_evaluation_picture(options.pictures / f"{path.name}.png", drawing, drawn, errors)
    return SampleResult(
        path.name,
        capture.record.object_id,
        source,
        errors,
        timings,
        failures,
        {name: errors_of(reference.limited_to(region)) for name, region in regions.items()},
        traits_of(capture.record.settings),
    )


def _reconstruction(
    choice: MethodChoice, matching: Matching | None, depth_range: tuple[float, float]
) -> ReconstructionOptions:
    return ReconstructionOptions(choice.method, matching, depth_range, weights=choice.weights)


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
        first = options.matchings[0]
        rows.setdefault(_row("nstep", first), (capture, ReconstructionOptions("nstep", first, depth_range)))
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
