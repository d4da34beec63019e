"""From a capture to a point map: phase extraction, matching, triangulation, rejection."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from models.capture import Capture
from models.errors import CalibrationError, CaptureError, ReconstructionError
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import PatternKind
from models.phase.fringe import FringePhase, PhaseExtractor
from models.phase.nstep import NStep
from models.phase.shearlet import Shearlet
from models.phase.wavelet1d import Wavelet1d
from models.phase.wavelet2d import Wavelet2d
from models.phase.wft import WindowedFourierTransform
from models.points import PointMap, Reason
from models.refiner.extractor import RefinedFourierTransform
from models.refiner.weights import WeightsRecord
from models.stereo.candidates import CandidateSettings
from models.stereo.exchanged import views_look_exchanged
from models.stereo.matcher import MATCHINGS, MatcherSettings, Matching, PhaseMatcher
from models.stereo.point_map import RejectionSettings, build_point_map, projector_residual

Method = Literal["nstep", "wft", "wavelet1d", "wavelet2d", "shearlet", "refiner"]
METHODS: tuple[Method, ...] = get_args(Method)
Progress = Callable[[str, float], None]
_SINGLE_SHOT: dict[Method, type[WindowedFourierTransform | Wavelet1d | Wavelet2d | Shearlet]] = {
    "wft": WindowedFourierTransform,
    "wavelet1d": Wavelet1d,
    "wavelet2d": Wavelet2d,
    "shearlet": Shearlet,
}
SINGLE_SHOT_METHODS: tuple[Method, ...] = (*_SINGLE_SHOT, "refiner")
"""The methods that take one composite exposure."""
_NSTEP_KINDS: frozenset[PatternKind] = frozenset({"white", "black", "high", "low", "gray", "gray_inv"})
_CERTAIN_MATCHING = MatcherSettings(
    candidates=CandidateSettings(low_scale=0.3, high_scale=0.3, projector_low_scale=0.25, misfit_scale=0.8),
    jump_cost=3.0,
    ambiguity=0.5,
)
_CERTAIN_REJECTION = RejectionSettings(
    low=1.0,
    projector=0.8,
    jump_misfit=0.8,
    rim_misfit=2.5,
    carrier_weights=(1.0, 0.4),
    growth_misfit=1.3,
)
"""For phases that tell their own certainty: closer where they are sure, more patient where they are not."""
_FEWEST_POINTS = 200
_SUSPICIOUS_RESIDUAL, _SUSPICIOUS_CERTAIN_RESIDUAL, _SUSPICIOUS_ABSOLUTE_RESIDUAL = 0.2, 0.1, 0.08
"""Median of rad between a view and the projector, for wrapped phases, those that tell their certainty, and absolute
ones, above which the views are tried the other way round."""


@dataclass(frozen=True)
class ReconstructionOptions:
    """What to compute. matching: None means trinocular where the rig has a projector, else stereo.

    depth_range: (min, max) mm; None means the rig's common working volume. device: torch device of the phase stage.
    weights: of the method refiner, see ``models.refiner.find_weights``; None for the default.
    """

    method: Method = "wft"
    matching: Matching | None = None
    depth_range: tuple[float, float] | None = None
    device: str = "cpu"
    weights: str | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A point map with what it was made from. timings_s: seconds per stage. weights: of the refiner, else None."""

    points: PointMap
    phases: Mapping[Side, FringePhase]
    rig: Rig
    options: ReconstructionOptions
    depth_range: tuple[float, float]
    matching: Matching
    timings_s: dict[str, float] = field(default_factory=dict)
    weights: WeightsRecord | None = None


def kinds_needed(method: Method) -> frozenset[PatternKind]:
    """Pattern groups that a method reads where a capture has them; pass to ``read_capture``."""
    return _NSTEP_KINDS if method == "nstep" else frozenset({"composite"})


def reconstruct(
    capture: Capture, options: ReconstructionOptions, *, rig: Rig | None = None, progress: Progress | None = None
) -> Reconstruction:
    """Reconstruct a two-view capture.

    rig: calibration to use in place of the capture's own copy. progress: called with (stage, share done).
    Raises CalibrationError without a usable calibration, CaptureError for a capture that lacks what the method needs,
    and ReconstructionError, with the likely cause, instead of returning an empty or nearly empty cloud.
    """
    rig = rig or capture.rig
    if rig is None:
        raise CalibrationError(f"{capture.source}: has no calibration; pass --calibration FILE")
    matching = _matching(options, rig)
    _check_views(capture, rig, options.method)
    depth_range = options.depth_range or rig.working_depths
    if not 0 < depth_range[0] < depth_range[1]:
        raise ReconstructionError(
            f"depth range {depth_range[0]:g}..{depth_range[1]:g} mm: MIN must be positive and below MAX"
        )
    timings: dict[str, float] = {}
    report = progress or (lambda stage, share: None)
    clock = time.perf_counter
    start = clock()
    report("phase", 0.0)
    extractor = _extractor(options, rig, depth_range)
    phases = extractor.extract(capture)
    timings["phase"] = clock() - start
    report("matching", 0.3)
    start = clock()
    certain = all(phases[side].certainty is not None for side in SIDES)
    matches = PhaseMatcher(matching, _CERTAIN_MATCHING if certain else None).match(phases, rig, depth_range)
    timings["matching"] = clock() - start
    report("points", 0.7)
    start = clock()
    absolute = all(phases[side].column is not None for side in SIDES)
    settings = _CERTAIN_REJECTION if certain else _rejection(capture, options.method, absolute=absolute)
    points = build_point_map(phases, matches, rig, depth_range, settings, use_projector=matching == "trinocular")
    timings["points"] = clock() - start
    if _projector_disagrees(points, phases["left"], rig) and views_look_exchanged(phases, rig, depth_range):
        raise ReconstructionError(f"{capture.source}: the views look swapped; exchange left/ and right/")
    if len(points) < _FEWEST_POINTS:
        raise ReconstructionError(f"{capture.source}: {_cause_of_emptiness(points, depth_range)}")
    report("done", 1.0)
    record = extractor.record if isinstance(extractor, RefinedFourierTransform) else None
    return Reconstruction(points, phases, rig, options, depth_range, matching, timings, record)


def _matching(options: ReconstructionOptions, rig: Rig) -> Matching:
    if options.matching is None:
        return "trinocular" if rig.projector is not None else "stereo"
    if options.matching not in MATCHINGS:
        raise ReconstructionError(f"matching '{options.matching}' is unknown; choose {' or '.join(MATCHINGS)}")
    if options.matching == "trinocular" and rig.projector is None:
        raise CalibrationError("matching trinocular needs a calibrated projector; the calibration has none, use stereo")
    return options.matching


def _check_views(capture: Capture, rig: Rig, method: Method) -> None:
    capture.require_two_views(f"method {method}")
    for side in capture.sides:
        images = capture.images[side]
        if not images:
            continue
        height, width = next(iter(images.values())).shape
        camera = rig.cameras[side]
        if (width, height) != camera.size:
            raise CaptureError(
                f"{capture.source}: {side} images are {width}x{height} "
                f"but the calibration is for {camera.width}x{camera.height}"
            )


def _extractor(options: ReconstructionOptions, rig: Rig, depth_range: tuple[float, float]) -> PhaseExtractor:
    if options.method == "refiner":
        return RefinedFourierTransform(rig, depth_range, options.weights, device=options.device)
    if options.weights is not None:
        raise ReconstructionError(f"method '{options.method}' takes no weights; only refiner does")
    if options.method == "nstep":
        return NStep(device=options.device)
    if options.method in _SINGLE_SHOT:
        return _SINGLE_SHOT[options.method](rig, depth_range, device=options.device)
    raise ReconstructionError(f"method '{options.method}' is unknown; choose {', '.join(METHODS)}")


def _rejection(capture: Capture, method: Method, *, absolute: bool) -> RejectionSettings:
    if method in SINGLE_SHOT_METHODS:
        return RejectionSettings()
    weights = (float(len(capture.plan.of_kind("high"))), float(len(capture.plan.of_kind("low"))))
    return RejectionSettings(low=0.4, projector=0.6, smallest_surface=40 if absolute else 400, carrier_weights=weights)


def _projector_disagrees(points: PointMap, left: FringePhase, rig: Rig) -> bool:
    """Whether the projector shows the points other phases than the left camera saw there, or there are hardly any."""
    if len(points) < _FEWEST_POINTS:
        return True
    if rig.projector is None:
        return False
    limit = _SUSPICIOUS_RESIDUAL if left.certainty is None else _SUSPICIOUS_CERTAIN_RESIDUAL
    if left.column is not None:
        limit = _SUSPICIOUS_ABSOLUTE_RESIDUAL
    rows = slice(None, None, 8)
    sparse = replace(left, carriers=left.carriers[:, rows])
    residual = projector_residual(points.points[rows].astype(np.float64), sparse, rig)
    return bool(np.isfinite(residual).any() and np.nanmedian(np.abs(residual)) > limit)


def _cause_of_emptiness(points: PointMap, depth_range: tuple[float, float]) -> str:
    counts = {reason: int((points.mask == reason).sum()) for reason in Reason if reason is not Reason.VALID}
    worst = max(counts, key=lambda reason: counts[reason])
    share = counts[worst] / points.mask.size
    causes = {
        Reason.UNLIT: "the projector's light does not reach the scene; check lamp, trigger and exposure",
        Reason.LOW_MODULATION: "the fringes are too weak; raise the exposure, focus the projector, check the pattern",
        Reason.SATURATED: "the images are saturated; lower the exposure or gain",
        Reason.NO_MATCH: "the views do not match; check the calibration, swapped views and the depth range",
        Reason.AMBIGUOUS: "the matches contradict each other; check the calibration and the pattern's periods",
        Reason.OUT_OF_RANGE: f"the matches lie outside {depth_range[0]:g}..{depth_range[1]:g} mm; check --depth-range",
        Reason.ISOLATED: "only scattered points matched; check the calibration and the depth range",
    }
    name = worst.name.lower().replace("_", " ")
    return f"only {len(points)} points; {share:.0%} of the pixels are {name}: {causes[worst]}"
