"""A plan as the audit sees it: carriers and code planes of each coded direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from models.patterns import Pattern, PatternKind, PatternPlan

FloatArray = npt.NDArray[np.floating]
ComplexArray = npt.NDArray[np.complexfloating]
IntArray = npt.NDArray[np.signedinteger]


@dataclass(frozen=True, eq=False)
class Carrier:
    """One N-step group. members: places in the plan. angles: by which each member lags the phase 2 pi u / period."""

    kind: PatternKind
    period: float
    steps: int
    members: IntArray
    angles: FloatArray

    @property
    def step_angle(self) -> float:
        return float(2 * np.pi / self.steps)


@dataclass(frozen=True, eq=False)
class Code:
    """Gray planes of one direction, inverted ones among them.

    period: columns that a word covers. members: places in the plan. signs (members, words): +1 where a member is
    bright in a word, else -1.
    """

    period: float
    members: IntArray
    bits: IntArray
    signs: FloatArray


@dataclass(frozen=True, eq=False)
class Axis:
    """One coded direction, u or v: carriers, high first, and the code, if any."""

    name: str
    carriers: tuple[Carrier, ...]
    code: Code | None

    @cached_property
    def members(self) -> IntArray:
        parts = [carrier.members for carrier in self.carriers] + ([self.code.members] if self.code else [])
        return np.concatenate(parts)


def axes_of(plan: PatternPlan) -> tuple[Axis, ...]:
    """The directions that have at least one N-step carrier."""
    found = []
    for name, prefix in (("u", ""), ("v", "row_")):
        carriers = tuple(c for kind in ("high", "low") if (c := _carrier(plan, prefix + kind)) is not None)
        if carriers:
            found.append(Axis(name, carriers, _code(plan, prefix)))
    return tuple(found)


def composite_angles(plan: PatternPlan, axis: Axis) -> tuple[int, tuple[float, float]] | None:
    """Place of the composite and its phase offsets, where the carriers of ``axis`` are the composite's; else None."""
    for place, pattern in enumerate(plan.patterns):
        if pattern.kind == "composite" and axis.name == "u":
            matching = len(axis.carriers) == 2 and all(
                np.isclose(p, c.period) for p, c in zip(pattern.periods, axis.carriers, strict=True)
            )
            if matching:
                return place, (pattern.phase_offsets[0], pattern.phase_offsets[1])
    return None


def _places(plan: PatternPlan, kinds: tuple[str, ...]) -> list[tuple[int, Pattern]]:
    return [(place, p) for place, p in enumerate(plan.patterns) if p.kind in kinds]


def _carrier(plan: PatternPlan, kind: str) -> Carrier | None:
    places = _places(plan, (kind,))
    if len(places) < 3:
        return None
    steps = places[0][1].steps or 0
    angles = [p.phase_offsets[0] + p.shift_sign * 2 * np.pi * (p.step or 0) / steps for _, p in places]
    return Carrier(
        places[0][1].kind,
        places[0][1].periods[0],
        steps,
        np.array([place for place, _ in places]),
        np.array(angles),
    )


def _code(plan: PatternPlan, prefix: str) -> Code | None:
    places = _places(plan, (prefix + "gray", prefix + "gray_inv"))
    if not places:
        return None
    bits = places[0][1].bits or 1
    words = np.arange(2**bits)
    gray = words ^ (words >> 1)
    rows = [np.where(((gray >> (bits - 1 - (p.bit or 0))) & 1 == 1) != p.is_inverted, 1.0, -1.0) for _, p in places]
    return Code(
        places[0][1].periods[0],
        np.array([place for place, _ in places]),
        np.array([p.bit or 0 for _, p in places]),
        np.array(rows, np.float32),
    )
