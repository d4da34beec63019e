"""The audit of one view."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from models.capture import Image
from models.patterns import PatternPlan
from service.acquisition.audit.axes import Axis, FloatArray, axes_of, composite_angles
from service.acquisition.audit.culprits import Diagnosis, Misplaced, diagnose
from service.acquisition.audit.drift import measure_drift
from service.acquisition.audit.explanation import BANDS, LEAST_STEPS, Explanation, Pixels, explain
from service.acquisition.audit.exposure import measure_exposure
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.motion import Motion, measure_motion
from service.acquisition.audit.order import pair_consistency
from service.acquisition.audit.rows import ROW_COUNTS, RowSample, sample_rows, stack_rows
from service.acquisition.audit.single import LEAST_STRETCHES, find_two_carriers
from service.acquisition.finding import Fault, Finding

PROVES_BELOW = 0.5
"""A pixel proves a pattern when its frame lies closer than this to the prediction, in fringe amplitudes."""


@dataclass
class ViewAudit:
    """What the images of one view tell. dark, diagnosis and motion are judged with those of the other view."""

    device: str
    findings: list[Finding] = field(default_factory=list)
    statistics: dict[str, Any] = field(default_factory=dict)
    proven: list[str] = field(default_factory=list)
    dark: bool = False
    diagnosis: Diagnosis | None = None
    motions: list[Motion] = field(default_factory=list)


def audit_view(
    device: str, images: Mapping[str, Image], plan: PatternPlan, white_level: int, limits: AuditLimits
) -> ViewAudit:
    """Audit one view; raises CaptureError where images of the plan are missing or differ in size."""
    view = ViewAudit(device)
    axes = axes_of(plan)
    if axes:
        _audit_fringes(view, images, plan, axes, white_level, limits)
    else:
        _audit_without_fringes(view, images, plan, white_level, limits)
    return view


def _audit_fringes(
    view: ViewAudit,
    images: Mapping[str, Image],
    plan: PatternPlan,
    axes: tuple[Axis, ...],
    white_level: int,
    limits: AuditLimits,
) -> None:
    sample = sample_rows(images, plan, axes, white_level, limits)
    exposure = measure_exposure(sample.levels, sample.saturated, sample.lit, plan, view.device, white_level, limits)
    view.findings += exposure.findings
    view.statistics |= exposure.statistics
    twins = _twins(sample, plan)
    lit = np.flatnonzero(sample.lit.ravel())
    if len(lit) < max(30, limits.least_lit * sample.lit.size):
        if exposure.saturated <= limits.saturated_fatal:
            _report_unlit(view, sample, plan, limits)
        return
    pixels = _lit_pixels(sample, axes, limits)
    explanation = explain(pixels, plan, axes, limits)
    assert explanation is not None
    _modulation(view, explanation, axes, white_level, limits)
    problems = [p for p in explanation.problems if p.place is None or exposure.saturated <= limits.saturated_fatal]
    _measure_motion(view, sample, plan, axes, limits)
    if problems:
        view.diagnosis = diagnose(pixels, plan, axes, limits, explanation)
    elif twins:
        view.diagnosis = Diagnosis((Misplaced(twins[1], plan.names[twins[0]]),))
    if problems and any(m.is_motion(limits) for m in view.motions) and _may_be_motion(view, plan, problems):
        view.diagnosis = None
    _proof(view, explanation, axes)


def _may_be_motion(view: ViewAudit, plan: PatternPlan, problems: list[Any]) -> bool:
    """Only fringes do not fit and none was recognised as another: they have merely moved."""
    assert view.diagnosis is not None
    if any(
        p.place is not None and (plan.patterns[p.place].is_gray or plan.patterns[p.place].is_uniform) for p in problems
    ):
        return False
    named = [m for m in view.diagnosis.misplaced if m.shown is not None]
    only_composite = all(p.place is not None and plan.patterns[p.place].kind == "composite" for p in problems)
    return not named or (only_composite and not any(plan.patterns[m.place].kind == "composite" for m in named))


def _report_unlit(view: ViewAudit, sample: RowSample, plan: PatternPlan, limits: AuditLimits) -> None:
    change = np.percentile(np.ptp(sample.levels, axis=0), 99.5)
    if change < limits.least_light:
        view.dark = True
        return
    message = (
        f"{view.device}: fringes show on {100 * sample.lit.mean():.2f} % of the view although light changes there; "
        "check focus, exposure and that the projector plays the plan"
    )
    view.findings.append(Finding(Fault.MODULATION, view.device, message))


def _lit_pixels(sample: RowSample, axes: tuple[Axis, ...], limits: AuditLimits) -> Pixels:
    """Evenly thinned lit pixels, those that no fringe saturates where there are enough of them."""
    members = np.concatenate([c.members for axis in axes for c in axis.carriers])
    clipped = sample.saturated[members].sum(axis=0) > 1
    chosen = np.flatnonzero((sample.lit & ~clipped).ravel())
    if len(chosen) < 0.2 * np.count_nonzero(sample.lit):
        chosen = np.flatnonzero(sample.lit.ravel())
    chosen = chosen[:: -(-len(chosen) // limits.sampled_pixels)]
    rows, width = sample.lit.shape
    one_carrier = any(axis.code is not None and len(axis.carriers) == 1 for axis in axes)
    levels = sample.levels.reshape(len(sample.levels), -1)[:, chosen]
    return Pixels(levels, (chosen // width) * BANDS // rows, sample if one_carrier else None)


def _modulation(
    view: ViewAudit, explanation: Explanation, axes: tuple[Axis, ...], white_level: int, limits: AuditLimits
) -> None:
    amplitudes = {c.kind: np.abs(explanation.fields[c.kind]) for axis in axes for c in axis.carriers}
    weakest = np.min(list(amplitudes.values()), axis=0)
    weak = float((weakest < limits.sure_modulation).mean())
    view.statistics["modulation"] = {
        kind: round(white_level * float(np.median(amplitude)), 2) for kind, amplitude in amplitudes.items()
    }
    view.statistics["under_exposed_percent"] = round(100 * weak, 2)
    if weak > limits.under_exposed_warning:
        message = (
            f"{view.device}: fringes are weaker than {white_level * limits.sure_modulation:.0f} grey levels on "
            f"{100 * weak:.0f} % of the lit pixels; lengthen the exposure or open the aperture"
        )
        view.findings.append(Finding(Fault.MODULATION, view.device, message, fatal=False))


def _measure_motion(
    view: ViewAudit, sample: RowSample, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits
) -> None:
    for axis in axes:
        if (composite := composite_angles(plan, axis)) is not None:
            view.motions.append(measure_motion(sample, axis, *composite, limits))
            view.statistics["composite_moved_percent"] = round(100 * view.motions[-1].moved, 2)
            view.statistics["composite_phase"] = round(view.motions[-1].typical, 3)
        if (drift := measure_drift(sample, axis, limits)) is not None:
            view.motions.append(drift)
            view.statistics[f"moved_percent_{axis.name}"] = round(100 * drift.moved, 2)


def _twins(sample: RowSample, plan: PatternPlan) -> tuple[int, int] | None:
    """The first two exposures that are the same image to the last bit of noise."""
    seen: dict[tuple[int, int], int] = {}
    for k, frame in enumerate(sample.raw):
        key = zlib.crc32(frame), int(frame.sum(dtype=np.int64))
        if key in seen and np.array_equal(frame, sample.raw[seen[key]]) and np.ptp(frame) > 2:
            return seen[key], k
        seen[key] = k
    return None


def _proof(view: ViewAudit, explanation: Explanation, axes: tuple[Axis, ...]) -> None:
    plan = explanation.plan
    unproven: dict[str, str] = {}
    doubted = set() if view.diagnosis is None else {m.place for m in view.diagnosis.misplaced}
    proven = set(explanation.proven()) - doubted
    for axis in axes:
        for carrier in axis.carriers:
            if not _start_is_known(explanation, axis):
                unproven[carrier.kind] = "no Gray code or composite tells the first phase step"
                proven -= set(carrier.members.tolist())
            elif carrier.steps <= 4 and not _direction_is_known(explanation, axis):
                unproven[carrier.kind] = "so few phase steps fit a reversed order as well"
                proven -= set(carrier.members.tolist())
        if axis.code is not None:
            weak = set(axis.code.members.tolist()) - _proven_planes(explanation, axis)
            unproven |= {plan.names[k]: "the code has no second witness here" for k in sorted(weak)}
            proven -= weak
    if explanation.ambient_black:
        unproven |= {p.name: "was taken with other light than the rest" for p in plan.of_kind("black")}
    unproven |= {
        plan.names[k]: "looks like another pattern of the plan on this scene, or could not be predicted"
        for k in range(len(plan))
        if k not in proven and plan.names[k] not in unproven and plan.patterns[k].kind not in unproven
    }
    view.proven = [plan.names[k] for k in sorted(proven)]
    view.statistics["unproven"] = unproven
    near = np.abs(explanation.readings - explanation.templates[: len(plan)]) < PROVES_BELOW
    view.statistics["proving_pixels_percent"] = {
        kind: round(100 * float(near[[k for k, p in enumerate(plan.patterns) if p.kind == kind]].mean()), 1)
        for kind in sorted(plan.kinds)
    }
    view.statistics["consistent_percent"] = {
        name: round(100 * float(orders.consistent.mean()), 2) for name, orders in explanation.orders.items()
    }


def _start_is_known(explanation: Explanation, axis: Axis) -> bool:
    return axis.code is not None or composite_angles(explanation.plan, axis) is not None


def _direction_is_known(explanation: Explanation, axis: Axis) -> bool:
    """Reversed steps make the phase fall where it rose; orders beside a second carrier, or along the rows, tell."""
    return axis.code is not None and (len(axis.carriers) > 1 or axis.name in explanation.steps)


def _proven_planes(explanation: Explanation, axis: Axis) -> set[int]:
    """Planes that the second carrier, or else the fringe steps along rows, bear out."""
    assert axis.code is not None
    orders = explanation.orders[axis.name]
    limits = explanation.limits
    good: npt.NDArray[np.bool_] = np.full(len(orders.used), False)
    if (steps := explanation.steps.get(axis.name)) is not None:
        good = np.asarray((steps.count >= LEAST_STEPS) & (steps.share >= limits.consistent))
    elif len(axis.carriers) > 1 and len(orders.used) > 1:
        count, share = pair_consistency(orders)
        good = np.asarray(((count > 25) & (share >= limits.consistent)).any(axis=1))
    return set(axis.code.members[orders.used[good]].tolist())


def _audit_without_fringes(
    view: ViewAudit, images: Mapping[str, Image], plan: PatternPlan, white_level: int, limits: AuditLimits
) -> None:
    """Plans without phase steps: the composite by its spectrum, white and black by their level."""
    height = images[plan.names[0]].shape[0] if plan.names[0] in images else 1
    rows = np.unique(((np.arange(min(ROW_COUNTS[0], height)) + 0.5) * height / min(ROW_COUNTS[0], height)).astype(int))
    raw = stack_rows(images, plan, rows)
    levels = raw.astype(np.float32) * np.float32(1 / white_level)
    saturated = raw >= white_level
    brightest = levels.max(axis=0)
    lit = brightest > max(limits.least_light, 0.25 * float(np.percentile(brightest, 99)))
    exposure = measure_exposure(levels, saturated, lit, plan, view.device, white_level, limits)
    view.findings += exposure.findings
    view.statistics |= exposure.statistics
    view.statistics["unproven"] = {p.name: "no phase steps to lay it against" for p in plan.patterns}
    if exposure.saturated > limits.saturated_fatal:
        return
    if np.percentile(brightest, 100 * (1 - limits.least_lit / 2)) < limits.least_light:
        view.dark = True
        return
    for place, pattern in enumerate(plan.patterns):
        if pattern.kind == "composite":
            _audit_composite(view, place, levels[place], saturated[place], lit, plan, limits)
    kinds = [p.kind for p in plan.patterns]
    if "white" in kinds and "black" in kinds:
        white, black = kinds.index("white"), kinds.index("black")
        if float(np.median((levels[white] - levels[black])[lit])) <= 0:
            view.diagnosis = Diagnosis((Misplaced(white, None), Misplaced(black, None)), "is darker than black")


def _audit_composite(
    view: ViewAudit,
    place: int,
    levels: FloatArray,
    saturated: npt.NDArray[np.bool_],
    lit: npt.NDArray[np.bool_],
    plan: PatternPlan,
    limits: AuditLimits,
) -> None:
    name = plan.names[place]
    high, low = plan.patterns[place].periods
    found = find_two_carriers(levels, saturated, low / high, limits)
    view.statistics["composite"] = {
        "stretches": found.stretches,
        "both_carriers_percent": round(100 * found.both, 1),
        "contrast": round(found.contrast, 4),
    }
    enough = found.stretches >= LEAST_STRETCHES
    brightest = float(np.percentile(levels, 100 * (1 - limits.least_lit / 2)))
    if enough and found.both >= limits.two_carriers:
        view.proven.append(name)
        del view.statistics["unproven"][name]
    elif not enough and len(plan) == 1 and brightest < 3 * limits.least_light:
        view.dark = True
    elif lit.mean() < limits.little_lit or (enough and levels.shape[-1] < limits.narrow):
        seen = "of the view is lit" if lit.mean() < limits.little_lit else f"of {levels.shape[-1]} px width is lit"
        view.statistics["unproven"][name] = "too little is seen of it"
        message = (
            f"{view.device}: {100 * lit.mean():.1f} % {seen}, too little to tell whether exposure "
            f"{place} ({name}) shows both carriers; bring the object closer or check the points"
        )
        view.findings.append(Finding(Fault.MODULATION, view.device, message, place, name, fatal=False))
    else:
        remark = "does not show both carriers" if enough else "shows no fringes"
        view.diagnosis = Diagnosis((Misplaced(place, None),), remark)
