"""From what a request asks for to the plan that this projector can show."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import ValidationError

from models.errors import DuofringeError
from models.patterns import PLAN_NAMES, Pattern, PatternKind, PatternPlan, PlanName, make_pattern, make_plan

PlanRequest = str | Sequence[str | Pattern]
_CODED: tuple[PatternKind, ...] = ("high", "low", "gray")
_KINDS: dict[PlanName, tuple[PatternKind, ...]] = {
    "composite": ("composite",),
    "reference": ("white", *_CODED, "black"),
    "full": ("white", "composite", *_CODED, "black"),
    "complementary": ("white", *_CODED, "gray_inv", "black"),
    "calibration": ("white", *_CODED, "row_high", "row_low", "row_gray", "black"),
}
_INDISPENSABLE: dict[PlanName, frozenset[PatternKind]] = {
    "composite": frozenset({"composite"}),
    "reference": frozenset({"high"}),
    "full": frozenset({"composite", "high"}),
    "complementary": frozenset({"high", "gray", "gray_inv"}),
    "calibration": frozenset({"high", "row_high"}),
}


class PlanError(DuofringeError):
    """The plan asked for does not exist, is incomplete, or is not stored in the projector."""


def resolve_plan(request: PlanRequest, stored: PatternPlan | None) -> PatternPlan:
    """The plan to show.

    request: a plan's name, or patterns in exposure order, each by name or in full. stored: the patterns that the
    projector is limited to, whose parameters then hold; None where it shows any. Raises PlanError.
    """
    if isinstance(request, str):
        return _named(request, stored)
    if not request:
        raise PlanError("plan: the list of patterns is empty; name at least one")
    patterns = tuple(p if isinstance(p, Pattern) else _pattern(p, stored) for p in request)
    try:
        plan = PatternPlan(patterns=patterns)
    except ValidationError as error:
        raise PlanError(f"plan: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from error
    missing = plan.missing_members
    if missing:
        raise PlanError(f"plan: groups must be whole to be decoded; it lacks {_shortened(missing)}")
    return plan


def with_exposure(plan: PatternPlan, exposure_us: float) -> PatternPlan:
    """The plan with every pattern lit for ``exposure_us``."""
    patterns = tuple(p.model_copy(update={"exposure_us": exposure_us}) for p in plan.patterns)
    return plan.model_copy(update={"patterns": patterns})


def _named(name: str, stored: PatternPlan | None) -> PatternPlan:
    known = next((plan for plan in PLAN_NAMES if plan == name), None)
    if known is None:
        raise PlanError(f"plan '{name}' is unknown; choose {', '.join(PLAN_NAMES)} or list the patterns")
    if stored is None:
        return make_plan(known)
    missing = _INDISPENSABLE[known] - stored.kinds
    if missing:
        held = ", ".join(sorted(stored.kinds))
        raise PlanError(f"plan '{name}' needs {', '.join(sorted(missing))} patterns; the projector holds only {held}")
    wanted = _KINDS[known]
    kept = tuple(p for p in stored.patterns if p.kind in wanted)
    return PatternPlan(name=known, patterns=kept)


def _pattern(name: str, stored: PatternPlan | None) -> Pattern:
    if stored is None:
        return make_pattern(name)
    for pattern in stored.patterns:
        if pattern.name == name:
            return pattern
    raise PlanError(f"pattern '{name}' is not stored in the projector; it holds {_shortened(stored.names)}")


def _shortened(names: Sequence[str]) -> str:
    shown = ", ".join(names[:6])
    return f"{shown} and {len(names) - 6} more" if len(names) > 6 else shown
