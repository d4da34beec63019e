"""Whether a projector can show a plan, and when its pulses come."""

from __future__ import annotations

import math

from drivers.errors import SequenceInvalidError
from drivers.projector import LoadedSequence, ProjectorInfo
from models.patterns import Pattern, PatternPlan

NAME = "projector"


def check_plan(plan: PatternPlan, period_us: float, info: ProjectorInfo) -> LoadedSequence:
    """The plan as a projector of these limits shows it; raises SequenceInvalidError naming what it cannot show.

    Pulses come ``period_us`` apart, and further where the dark time after the longest exposure needs it.
    """
    limits = info.limits
    if not plan.patterns:
        raise SequenceInvalidError(NAME, f"plan '{plan.name}' has no patterns")
    if len(plan) > limits.patterns:
        raise SequenceInvalidError(NAME, f"plan '{plan.name}' has {len(plan)} patterns; it shows {limits.patterns}")
    if not (math.isfinite(period_us) and period_us >= 0):
        raise SequenceInvalidError(NAME, f"a period of {period_us} us is impossible")
    exposures = [_exposure_us(pattern, period_us, info) for pattern in plan.patterns]
    missing = unstored(plan, info.stored)
    if missing is not None:
        raise SequenceInvalidError(NAME, f"pattern '{missing.name}' is not stored with these parameters")
    period_us = max(period_us, max(exposures) + limits.dark_us)
    pulses_us = tuple(k * period_us for k in range(len(plan)))
    return LoadedSequence(plan, pulses_us, pulses_us[-1] + exposures[-1])


def _exposure_us(pattern: Pattern, period_us: float, info: ProjectorInfo) -> float:
    limits = info.limits
    binary = pattern.is_uniform or pattern.is_gray
    least = limits.binary_exposure_us if binary else limits.exposure_us[0]
    most = limits.exposure_us[1]
    if pattern.exposure_us is None:
        raise SequenceInvalidError(NAME, f"pattern '{pattern.name}' has no exposure time; give it {least:g} us or more")
    if not least <= pattern.exposure_us <= most:
        depth = 1 if binary else 8
        raise SequenceInvalidError(
            NAME,
            f"pattern '{pattern.name}' is to last {pattern.exposure_us:g} us; "
            f"a pattern of {depth} bits takes {least:g} to {most:g} us",
        )
    if pattern.exposure_us > period_us:
        raise SequenceInvalidError(
            NAME,
            f"pattern '{pattern.name}' is to last {pattern.exposure_us:g} us, more than the period of {period_us:g} us",
        )
    return pattern.exposure_us


def unstored(plan: PatternPlan, stored: PatternPlan | None) -> Pattern | None:
    """The first pattern that a projector has not stored; exposures may differ."""
    if stored is None:
        return None
    known = {_without_exposure(p) for p in stored.patterns}
    return next((p for p in plan.patterns if _without_exposure(p) not in known), None)


def _without_exposure(pattern: Pattern) -> str:
    return pattern.model_copy(update={"exposure_us": None}).model_dump_json()
