"""What is projected: patterns, the rasters that show them, and plans of patterns.

A pattern is a function of the projector's continuous coordinates (u, v); a raster says at which (u, v) each
mirror shows its value. Patterns therefore know nothing of square or diamond mirrors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, model_validator

from models.errors import DuofringeError

FloatArray = npt.NDArray[np.floating]
RasterKind = Literal["square", "diamond"]
PatternKind = Literal[
    "composite", "high", "low", "gray", "gray_inv", "row_high", "row_low", "row_gray", "row_gray_inv", "white", "black"
]

MEAN_LEVEL = 127.5
"""Mean of every fringe pattern, in projector grey levels (0..255)."""
COMPOSITE_AMPLITUDE = 63.75
"""Amplitude of each cosine of the composite (paper, eq:composite); the sum stays within 0..255."""
MINIMUM_8BIT_EXPOSURE_US = 8333
"""Shortest exposure of an 8-bit pattern on the LightCrafter 4500, microseconds."""
MAXIMUM_STEPS = 1024
"""More phase steps than any projector plays; a larger number in a file is damage."""

_NAME = re.compile(
    r"^(?P<kind>(?:row_)?(?:high|low|gray_inv|gray)|composite|white|black)(?:_(?P<index>\d\d|[1-9]\d{2,}))?$"
)


class PatternIndexError(DuofringeError):
    """A pattern name counts further than its group goes."""


@dataclass(frozen=True)
class Raster:
    """The mirrors of a projector.

    On a diamond raster odd rows stand half a column to the right: mirror (column, row) sits at
    u = column + (row & 1) / 2, v = row. On a square raster u = column, v = row.
    """

    columns: int
    rows: int
    kind: RasterKind = "square"

    def lattice(self) -> tuple[FloatArray, FloatArray]:
        """Continuous coordinates (u, v) of every mirror, each float64 of shape (rows, columns), in mirrors."""
        v, u = np.mgrid[0 : self.rows, 0 : self.columns].astype(np.float64)
        if self.kind == "diamond":
            u += 0.5 * (v % 2)
        return u, v


LIGHTCRAFTER_4500 = Raster(912, 1140, "diamond")


class Pattern(BaseModel):
    """One projected pattern with every parameter that its decoding needs.

    ``period`` is in mirrors: of the fringe, of the two fringes (composite: high, low), or the width that one Gray
    code word covers. A fringe of step k shows
    127.5 + 127.5 cos(2 pi u / period - phase_offset - shift_sign 2 pi k / steps).
    """

    model_config = ConfigDict(frozen=True)

    name: str = Field(pattern=r"^[a-z0-9_]+$", max_length=64)
    kind: PatternKind
    period: float | tuple[float, float] | None = None
    step: int | None = None
    steps: int | None = Field(None, le=MAXIMUM_STEPS)
    bit: int | None = None
    bits: int | None = None
    exposure_us: float | None = Field(None, gt=0, allow_inf_nan=False)
    shift_sign: Literal[1, -1] = 1
    phase_offset: float | tuple[float, float] = 0.0

    @model_validator(mode="after")
    def _parameters_fit_the_kind(self) -> Pattern:
        if self.is_uniform:
            return self
        if self.kind == "composite":
            if not isinstance(self.period, tuple):
                raise ValueError(f"pattern {self.name}: a composite needs two periods [high, low]")
        elif not isinstance(self.period, float):
            raise ValueError(f"pattern {self.name}: needs one period in projector columns")
        if any(not (math.isfinite(p) and p > 0) for p in self.periods):
            raise ValueError(f"pattern {self.name}: periods must be positive, got {self.period}")
        if len(self.phase_offsets) != len(self.periods) or not all(map(math.isfinite, self.phase_offsets)):
            raise ValueError(f"pattern {self.name}: needs one finite phase_offset a period, got {self.phase_offset}")
        if self.is_fringe and not (
            self.steps and self.steps >= 3 and self.step is not None and 0 <= self.step < self.steps
        ):
            raise ValueError(f"pattern {self.name}: a fringe step needs 0 <= step < steps and at least 3 steps")
        if self.is_gray and not (self.bits and self.bit is not None and 0 <= self.bit < self.bits <= 16):
            raise ValueError(f"pattern {self.name}: a Gray plane needs 0 <= bit < bits <= 16")
        return self

    @property
    def is_uniform(self) -> bool:
        return self.kind in ("white", "black")

    @property
    def is_fringe(self) -> bool:
        """One step of an N-step set (the composite is not)."""
        return self.kind in ("high", "low", "row_high", "row_low")

    @property
    def is_gray(self) -> bool:
        return self.kind.removeprefix("row_").startswith("gray")

    @property
    def is_row_coded(self) -> bool:
        return self.kind.startswith("row_")

    @property
    def is_inverted(self) -> bool:
        return self.kind.endswith("_inv")

    @property
    def periods(self) -> tuple[float, ...]:
        """All periods in mirrors: two for the composite, none for white and black."""
        if self.period is None:
            return ()
        return self.period if isinstance(self.period, tuple) else (self.period,)

    @property
    def phase_offsets(self) -> tuple[float, ...]:
        """Phase offset of each carrier in radians, as many as ``periods``."""
        offset = self.phase_offset
        return offset if isinstance(offset, tuple) else (offset,) * len(self.periods)

    def evaluate(self, u: npt.ArrayLike, v: npt.ArrayLike = 0.0) -> FloatArray:
        """Grey level (0..255, float64) at continuous projector coordinates in mirrors; arrays broadcast."""
        along = np.asarray(v if self.is_row_coded else u, np.float64)
        along = along + np.zeros_like(np.asarray(u if self.is_row_coded else v, np.float64))
        if self.is_uniform:
            return np.full_like(along, 255.0 if self.kind == "white" else 0.0)
        if self.kind == "composite":
            waves = [np.cos(2 * np.pi * along / p - o) for p, o in zip(self.periods, self.phase_offsets, strict=True)]
            return MEAN_LEVEL + COMPOSITE_AMPLITUDE * (waves[0] + waves[1])
        if self.is_gray:
            return 255.0 * self._gray_bit(along)
        assert self.step is not None
        assert self.steps is not None
        shift = self.shift_sign * 2 * np.pi * self.step / self.steps
        return MEAN_LEVEL + MEAN_LEVEL * np.cos(2 * np.pi * along / self.periods[0] - self.phase_offsets[0] - shift)

    def _gray_bit(self, along: FloatArray) -> npt.NDArray[np.bool_]:
        assert self.bit is not None
        assert self.bits is not None
        order = np.floor(along / self.periods[0]).astype(np.int64)
        code = order ^ (order >> 1)
        bit = (code >> (self.bits - 1 - self.bit)) & 1
        return np.asarray((bit == 1) != self.is_inverted)

    def render(self, raster: Raster) -> npt.NDArray[np.uint8]:
        """The image to load into a projector, uint8 (rows, columns)."""
        return np.rint(np.clip(self.evaluate(*raster.lattice()), 0, 255)).astype(np.uint8)


class PatternPlan(BaseModel):
    """Patterns in the order of their exposures."""

    model_config = ConfigDict(frozen=True)

    name: str = "custom"
    patterns: tuple[Pattern, ...]

    @model_validator(mode="after")
    def _names_are_unique(self) -> PatternPlan:
        names = [p.name for p in self.patterns]
        if len(set(names)) != len(names):
            raise ValueError(f"plan {self.name}: a pattern name stands twice")
        for kind in sorted(self.kinds):
            members = self.of_kind(kind)
            if len({(p.period, p.steps, p.bits) for p in members}) > 1:
                raise ValueError(f"plan {self.name}: patterns of kind '{kind}' differ in period, steps or bits")
            indices = [p.bit if p.is_gray else p.step for p in members if p.is_gray or p.is_fringe]
            if len(set(indices)) != len(indices):
                raise ValueError(f"plan {self.name}: kind '{kind}' has one step or bit twice")
        return self

    def __len__(self) -> int:
        return len(self.patterns)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.patterns)

    @property
    def kinds(self) -> frozenset[PatternKind]:
        return frozenset(p.kind for p in self.patterns)

    def of_kind(self, kind: PatternKind) -> tuple[Pattern, ...]:
        """Patterns of one kind in exposure order; empty where the plan has none."""
        return tuple(p for p in self.patterns if p.kind == kind)

    @property
    def missing_members(self) -> tuple[str, ...]:
        """Names of the steps and planes that the plan's groups lack; empty when every group is whole."""
        missing: list[str] = []
        for kind in sorted(self.kinds):
            members = self.of_kind(kind)
            first = members[0]
            if not (first.is_fringe or first.is_gray):
                continue
            present = {p.step if first.is_fringe else p.bit for p in members}
            count = (first.steps if first.is_fringe else first.bits) or 1
            missing += [f"{kind}_{i:02d}" for i in range(count) if i not in present]
        return tuple(missing)

    def restricted_to(self, names: Iterable[str]) -> PatternPlan:
        """The same plan with only the named patterns, in plan order."""
        keep = frozenset(names)
        return PatternPlan(name=self.name, patterns=tuple(p for p in self.patterns if p.name in keep))


PlanName = Literal["composite", "reference", "full", "complementary", "calibration"]
PLAN_NAMES: tuple[PlanName, ...] = ("composite", "reference", "full", "complementary", "calibration")


@dataclass(frozen=True)
class FringeParameters:
    """Parameters from which the named plans are built.

    periods, row_periods: high and low fringe period in mirrors along u and v. On a diamond raster rows stand half
    a mirror apart, so rows take twice the period for the same size on the object.
    steps: number of phase steps of the high and low carrier.
    """

    periods: tuple[float, float] = (9.0, 14.0)
    row_periods: tuple[float, float] = (18.0, 28.0)
    steps: tuple[int, int] = (9, 14)
    raster: Raster = LIGHTCRAFTER_4500
    exposure_us: float | None = float(MINIMUM_8BIT_EXPOSURE_US)

    def gray_bits(self, row_coded: bool = False) -> int:
        """Planes needed to tell every fringe order of the high carrier apart."""
        extent = self.raster.rows if row_coded else self.raster.columns
        period = (self.row_periods if row_coded else self.periods)[0]
        return max(1, math.ceil(math.log2(math.ceil(extent / period))))


def make_pattern(name: str, parameters: FringeParameters | None = None) -> Pattern:
    """The pattern that a file name stands for (``high_03``, ``gray_inv_00``, ``white`` ...).

    Raises DuofringeError for a name outside the naming of capture folders, and PatternIndexError for a step or bit
    beyond those of ``parameters``.
    """
    parameters = parameters or FringeParameters()
    match = _NAME.match(name)
    if match is None or (match["index"] is None) != (match["kind"] in ("composite", "white", "black")):
        raise DuofringeError(
            f"pattern name '{name}' is unknown; "
            "known are white, composite, high_00, low_00, gray_00, gray_inv_00, row_high_00 ..., black"
        )
    kind: PatternKind = match["kind"]  # type: ignore[assignment]  # the expression admits only these
    if kind in ("white", "black"):
        return Pattern(name=name, kind=kind, exposure_us=parameters.exposure_us)
    if kind == "composite":
        return Pattern(name=name, kind=kind, period=parameters.periods, exposure_us=parameters.exposure_us)
    row_coded = kind.startswith("row_")
    periods = parameters.row_periods if row_coded else parameters.periods
    carrier = 0 if kind.endswith("high") else 1
    index = int(match["index"])
    count = parameters.gray_bits(row_coded) if "gray" in kind else parameters.steps[carrier]
    if index >= count:
        raise PatternIndexError(
            f"pattern name '{name}' is beyond the {count} of its group ({kind}_00 .. {kind}_{count - 1:02d}); "
            "patterns with other parameters need a capture.json that states them"
        )
    if "gray" in kind:
        return Pattern(
            name=name, kind=kind, period=periods[0], bit=index, bits=count, exposure_us=parameters.exposure_us
        )
    return Pattern(
        name=name,
        kind=kind,
        period=periods[carrier],
        step=index,
        steps=count,
        exposure_us=parameters.exposure_us,
    )


def make_plan(name: PlanName, parameters: FringeParameters | None = None) -> PatternPlan:
    """A named plan.

    composite: the single exposure. reference: N-step of both carriers and Gray planes between white and black, the
    sentinels of the sequence. full: reference and composite. complementary: reference with each Gray plane also
    inverted. calibration: reference and its row-coded twin.
    """
    parameters = parameters or FringeParameters()
    return PatternPlan(name=name, patterns=tuple(make_pattern(n, parameters) for n in _plan_names(name, parameters)))


def _plan_names(plan: PlanName, parameters: FringeParameters) -> Iterator[str]:
    if plan == "composite":
        yield "composite"
        return
    yield "white"
    if plan == "full":
        yield "composite"
    yield from _coded_names("", parameters, complementary=plan == "complementary")
    if plan == "calibration":
        yield from _coded_names("row_", parameters, complementary=False)
    yield "black"


def _coded_names(prefix: str, parameters: FringeParameters, *, complementary: bool) -> Iterator[str]:
    yield from (f"{prefix}high_{k:02d}" for k in range(parameters.steps[0]))
    yield from (f"{prefix}low_{k:02d}" for k in range(parameters.steps[1]))
    bits = parameters.gray_bits(row_coded=prefix == "row_")
    yield from (f"{prefix}gray_{b:02d}" for b in range(bits))
    if complementary:
        yield from (f"{prefix}gray_inv_{b:02d}" for b in range(bits))
