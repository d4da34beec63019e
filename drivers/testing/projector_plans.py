"""Short plans for projectors that show any pattern and for those that hold a few."""

from __future__ import annotations

from drivers.projector import ProjectorInfo
from models.patterns import FringeParameters, Pattern, PatternPlan, make_pattern

_NAMES = ("white", *(f"high_{step:02d}" for step in range(9)), "composite", "black")


def showable(info: ProjectorInfo, count: int, exposure_us: float | None = None) -> PatternPlan:
    """A plan of ``count`` patterns, fewer where the projector stores fewer.

    exposure_us: of each pattern; default the shortest of an 8-bit pattern.
    """
    stored = info.stored.patterns if info.stored is not None else tuple(make_pattern(name) for name in _NAMES)
    lit = info.limits.exposure_us[0] if exposure_us is None else exposure_us
    return PatternPlan(name="contract", patterns=tuple(exposed(pattern, lit) for pattern in stored[:count]))


def exposed(pattern: Pattern, exposure_us: float | None) -> Pattern:
    """The pattern with another exposure."""
    return pattern.model_copy(update={"exposure_us": exposure_us})


def with_exposure(plan: PatternPlan, index: int, exposure_us: float | None) -> PatternPlan:
    """The plan with another exposure of one pattern."""
    patterns = [exposed(p, exposure_us) if i == index else p for i, p in enumerate(plan.patterns)]
    return PatternPlan(name=plan.name, patterns=tuple(patterns))


def eight_bit_index(plan: PatternPlan) -> int | None:
    """Where the first pattern stands that takes more than black and white."""
    return next((i for i, p in enumerate(plan.patterns) if not (p.is_uniform or p.is_gray)), None)


def unknown_pattern(info: ProjectorInfo) -> Pattern:
    """A pattern that a projector with stored patterns does not hold."""
    parameters = FringeParameters(periods=(31.25, 77.5), exposure_us=info.limits.exposure_us[0])
    return make_pattern("composite", parameters)


def too_long(info: ProjectorInfo) -> PatternPlan:
    """A plan of one pattern more than the longest sequence."""
    count = info.limits.patterns + 1
    parameters = FringeParameters(steps=(count, 14), exposure_us=info.limits.exposure_us[0])
    return PatternPlan(name="long", patterns=tuple(make_pattern(f"high_{k:02d}", parameters) for k in range(count)))
