"""How well each frame is explained by each pattern, all predicted from the sequence itself.

Every frame k is laid against the prediction of every pattern p: 0 when it is its own pattern, 1 when it is p. What the
camera, the lens and the material do to a pattern is in the prediction, since that comes from the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from models.patterns import PatternPlan
from service.acquisition.audit.axes import Axis, ComplexArray, FloatArray, IntArray, composite_angles
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.order import Orders, best_rotation, decode_orders, pair_consistency
from service.acquisition.audit.pieces import sum_pixels
from service.acquisition.audit.rows import RowSample, fit_carrier, predict
from service.acquisition.audit.steps import FringeSteps, fringe_steps

BANDS = 4
"""Parts of the view, top to bottom, in which each frame is tested on its own."""
LEAST_IN_BAND = 300
LEAST_STEPS = 12
"""Changes of a plane along the rows from which their share says something."""
PLAIN = ("no projector light", "full projector light")
"""What a frame may show beyond the plan's patterns."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """Lit pixels of one view on which the order is proven: levels (exposures, P), band (P,) 0..BANDS-1, ascending.

    rows: whole rows, where the order can only be proven from neighbour to neighbour.
    """

    levels: FloatArray
    band: IntArray
    rows: RowSample | None = None


@dataclass(frozen=True)
class Problem:
    """Something that does not fit. place: exposure, None for a whole group. severity: larger is worse."""

    place: int | None
    text: str
    severity: float


@dataclass(frozen=True, eq=False)
class Explanation:
    """One reading of a sequence: ``shown[k]`` is the pattern that exposure k is taken for, -1 for a frame left out.

    readings: frames on the scale of the fringe, (exposures, P): -1 dark .. 1 bright. templates: predicted frames,
    (patterns + 2, P), the last two PLAIN. known: which of them could be predicted. towards: (exposures, patterns + 2),
    0 at the own template, 1 at the other's, NaN where both look alike. misfit: unexplained share of a fringe frame.
    """

    plan: PatternPlan
    axes: tuple[Axis, ...]
    limits: AuditLimits
    shown: IntArray
    readings: FloatArray
    templates: FloatArray
    known: npt.NDArray[np.bool_]
    weight: FloatArray
    towards: FloatArray
    torn: FloatArray
    misfit: FloatArray
    orders: dict[str, Orders]
    steps: dict[str, FringeSteps] = field(default_factory=dict)
    fields: dict[str, ComplexArray] = field(default_factory=dict)

    @cached_property
    def problems(self) -> tuple[Problem, ...]:
        """Everything that contradicts this reading, worst first."""
        found = [p for k in range(len(self.plan)) if (p := self._frame_problem(k)) is not None]
        found += [p for axis in self.axes if axis.code is not None for p in self._code_problems(axis)]
        return tuple(sorted(found, key=lambda p: -p.severity))

    def _frame_problem(self, k: int) -> Problem | None:
        if self.shown[k] < 0 or (self.plan.patterns[k].kind == "black" and self.ambient_black):
            return None
        towards = np.nan_to_num(self.towards[k], nan=-1.0)
        worst = float(towards.max())
        if worst > self.limits.contradiction:
            return Problem(k, f"shows {self.name_of(int(towards.argmax()))}", worst)
        if self.misfit[k] > self.limits.misfit:
            return Problem(k, "shows none of the plan's patterns", float(self.misfit[k]))
        torn = np.nan_to_num(self.torn[:, k], nan=-1.0)
        band, other = np.unravel_index(int(torn.argmax()), torn.shape)
        if torn[band, other] > self.limits.torn:
            part = f"quarter {band + 1} of its rows shows"
            return Problem(k, f"is torn: {part} {self.name_of(int(other))}", float(torn[band, other]))
        return None

    def _code_problems(self, axis: Axis) -> list[Problem]:
        assert axis.code is not None
        orders = self.orders.get(axis.name)
        if orders is None:
            return []
        found = []
        turn, lead = best_rotation(axis, orders)
        if turn and lead > 0.02:
            text = f"phase steps of {axis.carriers[0].kind} are {abs(turn)} out against the Gray code"
            found.append(Problem(None, text, 0.6))
        if (steps := self.steps.get(axis.name)) is not None:
            wrong = (steps.share < self.limits.consistent) & (steps.count >= LEAST_STEPS)
            if wrong.any():
                text = f"Gray planes along {axis.name} do not step with the phase"
                found.append(Problem(None, text, float(1 - steps.share[wrong].min())))
        if len(axis.carriers) < 2:
            return found
        count, share = pair_consistency(orders)
        bad = (share < self.limits.consistent) & (count > self._enough(0.01))
        if bad.any():
            return [
                *found,
                Problem(None, f"Gray planes and phases along {axis.name} disagree", float(1 - share[bad].min())),
            ]
        if len(orders.used) < 2 and orders.consistent.mean() < self.limits.consistent:
            found.append(Problem(None, f"Gray planes and phases along {axis.name} disagree", 0.5))
        return found

    def _enough(self, share: float) -> float:
        return float(max(25.0, share * self.readings.shape[1]))

    @cached_property
    def ambient_black(self) -> bool:
        """The black frame is bright without showing any pattern: taken with other light than the rest."""
        places = [k for k, p in enumerate(self.plan.patterns) if p.kind == "black"]
        if not places or self.shown[places[0]] != places[0]:
            return False
        reading = self.readings[places[0]]
        if np.median(reading) < -0.3:
            return False
        white = [k for k, p in enumerate(self.plan.patterns) if p.kind == "white"]
        if white and np.median(self.readings[white[0]]) < -0.3:
            return False
        # Noise averages out over neighbours; another light does not.
        if white and np.median(np.abs(_by_neighbours(reading - self.readings[white[0]]).mean(axis=1))) < 0.1:
            return False
        return not any(self._shows(reading, p) for p in range(len(self.plan)) if self.known[p])

    def _shows(self, reading: FloatArray, pattern: int) -> bool:
        """Whether a frame has the stripes of a pattern, under whatever other light."""
        if self.plan.patterns[pattern].is_uniform:
            return False
        template = self.templates[pattern]
        energy = float(template**2 @ self.weight)
        if float((reading - template) ** 2 @ self.weight) < 0.35 * energy:
            return True
        stripes, seen = _by_neighbours(template), _by_neighbours(reading)
        stripes, seen = stripes - stripes.mean(axis=1, keepdims=True), seen - seen.mean(axis=1, keepdims=True)
        if stripes.std() < 0.2 or seen.std() < 1e-6:
            return False
        return bool(abs((stripes * seen).mean()) > 0.4 * stripes.std() * seen.std())

    def proven(self) -> list[int]:
        """Places whose frame is clearly its own pattern and no other of the plan."""
        own = self.shown == np.arange(len(self.plan))
        rivals = np.nan_to_num(self.towards, nan=-1.0).max(axis=1)
        told_apart = ~np.isnan(self.towards[:, :-2]) | ~self.known[:-2] | np.eye(len(self.plan), dtype=bool)
        return [
            int(k)
            for k in np.flatnonzero(own & self.known[:-2] & told_apart.all(axis=1) & (rivals < self.limits.proof))
        ]

    def nearest(self, k: int) -> tuple[int, float]:
        """The pattern that frame k resembles most, and the unexplained share of the frame's energy."""
        difference = (self.readings[k] - self.templates) ** 2 @ self.weight
        difference[~self.known] = np.inf
        best = int(difference.argmin())
        energy = float(self.templates[best] ** 2 @ self.weight)
        return best, float(difference[best]) / max(energy, 1e-9)

    def name_of(self, pattern: int) -> str:
        count = len(self.plan)
        if pattern < count:
            return self.plan.names[pattern]
        kind = ("black", "white")[pattern - count]
        return next((p.name for p in self.plan.patterns if p.kind == kind), PLAIN[pattern - count])


def _by_neighbours(values: FloatArray, group: int = 25) -> FloatArray:
    """Pixels (P,) in groups that follow each other along the rows, (P // group, group); all in one if there are few."""
    if len(values) < group:
        return values[None]
    return values[: len(values) // group * group].reshape(-1, group)


def explain(
    pixels: Pixels, plan: PatternPlan, axes: tuple[Axis, ...], limits: AuditLimits, shown: IntArray | None = None
) -> Explanation | None:
    """Fit and predict under one reading of the sequence; None where it leaves a carrier with too few frames."""
    shown = np.arange(len(plan)) if shown is None else shown
    means: list[FloatArray] = []
    fields: dict[str, ComplexArray] = {}
    for carrier in (c for axis in axes for c in axis.carriers):
        places = np.flatnonzero(np.isin(shown, carrier.members))
        angles = carrier.angles[np.searchsorted(carrier.members, shown[places])]
        if len(np.unique(np.round(np.mod(angles, 2 * np.pi), 6))) < 3:
            return None
        mean, fields[carrier.kind] = fit_carrier(pixels.levels[places], angles)
        means.append(mean)
    mean = np.mean(means, axis=0)
    zero = np.zeros_like(mean)
    span = np.maximum(np.max([np.abs(z) for z in fields.values()], axis=0), 1e-4)
    readings = np.clip((pixels.levels - mean) / span, -1.6, 1.6)
    templates = np.zeros((len(plan) + 2, len(mean)), np.float32)
    known = np.zeros(len(plan) + 2, bool)
    templates[-2], templates[-1], known[-2:] = -1.0, 1.0, True
    orders = {}
    for axis in axes:
        for carrier in axis.carriers:
            templates[carrier.members] = predict(zero, fields[carrier.kind] / span, carrier.angles)
            known[carrier.members] = True
        if (found := composite_angles(plan, axis)) is not None:
            halves = [
                predict(zero, fields[c.kind] / (2 * span), np.array([offset]))[0]
                for c, offset in zip(axis.carriers, found[1], strict=True)
            ]
            templates[found[0]], known[found[0]] = halves[0] + halves[1], True
        if (decoded := _orders(axis, fields, readings, shown, limits)) is not None and axis.code is not None:
            orders[axis.name] = decoded
            templates[axis.code.members], known[axis.code.members] = axis.code.signs[:, decoded.words], True
    for place, pattern in enumerate(plan.patterns):
        if pattern.is_uniform:
            templates[place], known[place] = 1.0 if pattern.kind == "white" else -1.0, True
    weight = np.minimum(span, np.median(span)) / np.median(span)
    towards, torn = _towards(readings, templates, known, weight, shown, pixels.band)
    misfit = _misfit(plan, readings, templates, weight, shown)
    steps = {}
    if pixels.rows is not None:
        steps = {a.name: _steps(pixels.rows, a, shown) for a in axes if a.name == "u" and a.name in orders}
    return Explanation(
        plan, axes, limits, shown, readings, templates, known, weight, towards, torn, misfit, orders, steps, fields
    )


def _steps(rows: RowSample, axis: Axis, shown: IntArray) -> FringeSteps:
    """Fringe steps of the axis along the sampled rows under a reading of the sequence."""
    assert axis.code is not None
    high = axis.carriers[0]
    places = np.flatnonzero(np.isin(shown, high.members))
    mean, field = fit_carrier(rows.levels[places], high.angles[np.searchsorted(high.members, shown[places])])
    planes = np.flatnonzero(np.isin(shown, axis.code.members))
    used = np.searchsorted(axis.code.members, shown[planes])
    readings = np.clip((rows.levels[planes] - mean) / np.maximum(np.abs(field), 1e-4), -1.0, 1.0)
    return fringe_steps(axis, field, readings, used, rows.lit)


def _orders(
    axis: Axis, fields: dict[str, ComplexArray], readings: FloatArray, shown: IntArray, limits: AuditLimits
) -> Orders | None:
    if axis.code is None:
        return None
    places = np.flatnonzero(np.isin(shown, axis.code.members))
    if not len(places):
        return None
    used = np.searchsorted(axis.code.members, shown[places])
    carriers = [fields[c.kind] for c in axis.carriers]
    return decode_orders(axis, carriers, np.clip(readings[places], -1.0, 1.0), used, limits.low_phase)


def _towards(
    readings: FloatArray,
    templates: FloatArray,
    known: npt.NDArray[np.bool_],
    weight: FloatArray,
    shown: IntArray,
    band: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Where each frame lies between its own template and each other: whole view (N, M), and by band (BANDS, N, M)."""
    weighted = templates * weight
    own = np.maximum(shown, 0)
    sums, starts = sum_pixels(np.concatenate([readings, templates]), weighted)
    of_band = [sums[band[starts] == b].sum(axis=0) for b in range(BANDS)]
    crosses = [total[: len(readings)] for total in of_band]
    products = [total[len(readings) :] for total in of_band]
    totals = [float(weight[band == b].sum()) for b in range(BANDS)]
    counts = [int(np.count_nonzero(band == b)) for b in range(BANDS)]
    usable = known[None, :] & known[own][:, None] & (shown >= 0)[:, None]

    def position(cross: FloatArray, product: FloatArray, least: float) -> FloatArray:
        square = np.diagonal(product)
        apart = square[own][:, None] - 2 * product[own] + square[None, :]
        along = cross - np.take_along_axis(cross, own[:, None], 1) - product[own] + square[own][:, None]
        return np.where(usable & (apart > least), along / np.maximum(apart, 1e-9), np.nan)

    whole = position(np.sum(crosses, axis=0), np.sum(products, axis=0), max(60.0, 0.004 * sum(totals)))
    parts = [
        position(cross, product, max(60.0, 0.05 * total)) if count >= LEAST_IN_BAND else np.full_like(whole, np.nan)
        for cross, product, total, count in zip(crosses, products, totals, counts, strict=True)
    ]
    return whole, np.stack(parts)


def _misfit(
    plan: PatternPlan, readings: FloatArray, templates: FloatArray, weight: FloatArray, shown: IntArray
) -> FloatArray:
    """Unexplained share of each fringe or composite frame; zero for others, which the lens may blur at will."""
    misfit = np.zeros(len(plan))
    for k, p in enumerate(shown):
        if p >= 0 and (plan.patterns[p].is_fringe or plan.patterns[p].kind == "composite"):
            energy = float(templates[p] ** 2 @ weight)
            misfit[k] = float((readings[k] - templates[p]) ** 2 @ weight) / energy if energy > 0 else 0.0
    return misfit
