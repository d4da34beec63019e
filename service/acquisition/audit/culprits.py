"""When a sequence does not fit its plan: which frames show what."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from models.patterns import PatternPlan
from service.acquisition.audit.axes import Axis, Carrier, FloatArray, IntArray
from service.acquisition.audit.explanation import Explanation, Pixels, Problem, explain
from service.acquisition.audit.limits import AuditLimits

RECOGNISED = 0.35
"""Largest unexplained share at which a left-out frame is taken for the pattern that it resembles most."""
SHIFTS = (1, -1, 2, -2)
ENOUGH_PIXELS = 2000
FEW_STEPS = 5
"""Groups up to this size have too little redundancy to find a wrong frame by leaving it out."""


@dataclass(frozen=True)
class Misplaced:
    """Exposure ``place`` shows ``shown`` (a name), or is not recognised (None)."""

    place: int
    shown: str | None


@dataclass(frozen=True)
class Diagnosis:
    """misplaced: in order of exposure. remark: what is wrong where no single frame can be named."""

    misplaced: tuple[Misplaced, ...]
    remark: str | None = None


def diagnose(
    pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits, first: Explanation
) -> Diagnosis:
    """Find a reading of the sequence without contradictions; ``first`` is the one of the plan, which has some."""
    thin = slice(None, None, max(1, pixels.levels.shape[1] // ENOUGH_PIXELS))
    pixels = Pixels(pixels.levels[:, thin], pixels.band[thin], pixels.rows)
    fallback: Diagnosis | None = None
    for reading in _candidates(pixels, plan, axes, limits):
        if reading.problems:
            continue
        misplaced = tuple(m for k, name in enumerate(plan.names) if (m := _named(reading, k)).shown != name)
        if misplaced and all(m.shown is not None for m in misplaced):
            return Diagnosis(misplaced)
        if misplaced and fallback is None:
            fallback = Diagnosis(misplaced)
    return fallback or _undecided(first.problems)


def _named(reading: Explanation, k: int) -> Misplaced:
    """What exposure k shows under a reading; a frame left out is named by what it resembles."""
    if reading.shown[k] >= 0:
        return Misplaced(k, reading.name_of(int(reading.shown[k])))
    nearest, rest = reading.nearest(k)
    return Misplaced(k, reading.name_of(nearest) if rest < RECOGNISED else None)


def _undecided(problems: tuple[Problem, ...]) -> Diagnosis:
    """The contradictions as they are: the earliest frame of those that stand out."""
    frames = [p for p in problems if p.place is not None]
    if not frames:
        return Diagnosis((), problems[0].text)
    clear = [p for p in frames if p.severity > 0.5 * frames[0].severity]
    earliest = min(clear, key=lambda p: p.place or 0)
    return Diagnosis((Misplaced(earliest.place or 0, None),), earliest.text)


def _candidates(
    pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits
) -> Iterator[Explanation]:
    """Readings to try, the likely ones first."""

    def read(shown: IntArray) -> Iterator[Explanation]:
        explanation = explain(pixels, plan, axes, limits, shown)
        if explanation is not None:
            yield explanation

    places = np.arange(len(plan))
    if pixels.rows is not None:
        groups = [places]
    else:
        groups = [c.members for axis in axes for c in axis.carriers if c.steps <= FEW_STEPS]
    for members in groups:
        found = [e for a, b in combinations(members.tolist(), 2) for e in read(_exchanged(places, a, b))]
        yield from sorted((e for e in found if not e.problems), key=_doubt)
    start = places.copy()
    for carrier in (c for axis in axes for c in axis.carriers):
        start[odd_frames(pixels.levels, carrier)] = -1
    yield from _trimmed(pixels, plan, axes, limits, start, most=3)
    shifts = [_shifted(places, shift, 0) for shift in SHIFTS]
    shifts += [_shifted(places, shift, begin) for begin in range(1, len(plan)) for shift in SHIFTS[:2]]
    found = [e for shown in shifts for e in read(shown)]
    yield from sorted((e for e in found if not e.problems), key=lambda e: float(np.nanmax(e.towards)))
    yield from _rotated(pixels, plan, axes, limits)
    yield from _trimmed(pixels, plan, axes, limits, start, most=max(4, len(plan) // 3))


def _doubt(reading: Explanation) -> float:
    """Less is better, among readings that nothing contradicts."""
    faltering = [float((1 - s.share[s.count > 0]).mean()) for s in reading.steps.values() if (s.count > 0).any()]
    return float(reading.misfit.max()) + sum(faltering)


def odd_frames(levels: FloatArray, carrier: Carrier) -> list[int]:
    """Up to two places of a carrier without which the rest fit far better than with them."""
    count = len(carrier.members)
    if count <= FEW_STEPS:
        return []
    stack = levels[carrier.members] - levels[carrier.members].mean(axis=0)
    gram = (stack @ stack.T).astype(np.float64)
    design = np.stack([np.ones(count), np.cos(carrier.angles), np.sin(carrier.angles)], axis=1)

    def rest(left_out: tuple[int, ...]) -> float:
        keep = np.setdiff1d(np.arange(count), left_out)
        residual = np.eye(len(keep)) - design[keep] @ np.linalg.pinv(design[keep])
        return float((residual * gram[np.ix_(keep, keep)]).sum()) / max(len(keep) - 3, 1)

    best = [min(combinations(range(count), n), key=rest) for n in (0, 1, 2)]
    bearable = 2 * rest(best[2])
    fewest = next(left_out for left_out in best if rest(left_out) <= bearable)
    return [int(carrier.members[i]) for i in fewest]


def _shifted(places: IntArray, shift: int, begin: int) -> IntArray:
    """From ``begin`` on every frame shows the pattern that came ``shift`` exposures before; the ends are left open."""
    shown = np.where(places < begin, places, places - shift)
    shown[(shown < 0) | (shown >= len(places))] = -1
    return shown


def _exchanged(places: IntArray, a: int, b: int) -> IntArray:
    shown = places.copy()
    shown[a], shown[b] = b, a
    return shown


def _trimmed(
    pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits, shown: IntArray, most: int
) -> Iterator[Explanation]:
    """Leave out the worst frame until the rest agree; code planes one or two at a time."""
    planes = {int(k) for axis in axes if axis.code is not None for k in axis.code.members}
    for _ in range(most + 1):
        current = explain(pixels, plan, axes, limits, shown)
        if current is None:
            return
        if not current.problems:
            yield current
            return
        frames = [p.place for p in current.problems if p.place is not None]
        if planes.issuperset(frames):
            yield from _without_planes(pixels, plan, axes, limits, shown)
            if not frames:
                return
        shown = shown.copy()
        shown[frames[0]] = -1


def _without_planes(
    pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits, shown: IntArray
) -> Iterator[Explanation]:
    """Readings that leave out one or two more code planes, the most consistent first."""
    for count in (1, 2):
        found = []
        for axis in (a for a in axes if a.code is not None):
            assert axis.code is not None
            present = [int(k) for k in axis.code.members if shown[k] == k]
            for left_out in combinations(present, count):
                trial = shown.copy()
                trial[list(left_out)] = -1
                explanation = explain(pixels, plan, axes, limits, trial)
                if explanation is not None and not explanation.problems:
                    found.append(explanation)
        yield from sorted(found, key=lambda e: -sum(float(o.consistent.mean()) for o in e.orders.values()))


def _rotated(pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits) -> Iterator[Explanation]:
    """Readings in which whole carriers start with another step."""
    for axis in axes:
        turns = [
            [np.roll(c.members, t) for t in sorted(range(-(c.steps // 2), c.steps - c.steps // 2), key=abs)]
            for c in axis.carriers
            if len(c.members) == c.steps
        ]
        for group in turns:
            for turned in group[1:]:
                yield from _read_turned(pixels, plan, axes, limits, (turned,), (group[0],))
        if len(turns) == 2:
            for first in turns[0][1:]:
                for second in turns[1][1:]:
                    yield from _read_turned(pixels, plan, axes, limits, (first, second), (turns[0][0], turns[1][0]))


def _read_turned(
    pixels: Pixels,
    plan: PatternPlan,
    axes: tuple[Axis, ...],
    limits: AuditLimits,
    turned: tuple[IntArray, ...],
    places: tuple[IntArray, ...],
) -> Iterator[Explanation]:
    shown = np.arange(len(plan))
    for place, pattern in zip(places, turned, strict=True):
        shown[place] = pattern
    explanation = explain(pixels, plan, axes, limits, shown)
    if explanation is not None:
        yield explanation
