"""Absolute projector column from wrapped phases and Gray code words.

The coarse code says which cell of ``gray_period`` columns a pixel lies in; the high phase says where in its fringe. Of
the fringe orders that touch the cell (or its rival's, where a plane is in doubt) the one is taken that the low phase
supports. At a word's edge, where a blurred plane cannot tell, neighbouring orders lie far apart in low phase (2.24 rad
for 9 and 14 columns), so the low phase settles it. Where nothing settles it the pixel stays without a column.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from models.phase.gray_code import GrayCode

CERTAIN = 0.3
"""Below this margin a Gray plane may as well have read the other way."""


@dataclass(frozen=True)
class UnwrapTolerance:
    """How far the carriers may disagree before a pixel is refused.

    low_phase: rad, between the low phase measured and the one the column predicts; a mixed pixel at an object's edge
    shows as disagreement. cell: columns by which the high phase may leave its Gray cell where a plane's edge is
    blurred; 0.4 of it where every plane reads clearly.
    """

    low_phase: float = 0.4
    cell: float = 1.6


def absolute_column(
    carriers: torch.Tensor,
    periods: tuple[float, ...],
    steps: tuple[int, ...],
    code: GrayCode,
    gray_period: float,
    tolerance: UnwrapTolerance | None = None,
) -> torch.Tensor:
    """Projector column u, float32 (H, W), NaN where the code words and phases do not settle it.

    carriers: complex64 (C, H, W), C = 1 or 2, high first. The columns of both carriers are fused by their noise:
    variance of a carrier's column is proportional to (period / modulation)^2 / steps.
    """
    tolerance = tolerance or UnwrapTolerance()
    high_period = periods[0]
    in_fringe = torch.remainder(torch.angle(carriers[0]), 2 * torch.pi) * (high_period / (2 * torch.pi))
    best_cost = torch.full_like(in_fringe, torch.inf)
    second_cost = best_cost.clone()
    best = torch.full_like(in_fringe, torch.nan)
    # A plane that reads clearly is no blurred edge, so the pixel lies well inside its cell.
    reach = tolerance.cell * (1 - 0.6 * code.margin)
    for outside, column in _candidates(in_fringe, code, gray_period, high_period):
        cost = (outside / tolerance.cell) ** 2
        possible = outside <= reach
        if len(carriers) > 1:
            doubt = low_phase_error(carriers[1], column, periods[1]).abs()
            cost = cost + (doubt / tolerance.low_phase) ** 2
            possible &= doubt <= tolerance.low_phase
        cost = torch.where(possible, cost, torch.inf)
        same = (column - best).abs() < 0.5 * high_period
        better = cost < best_cost
        second_cost = torch.where(
            better & ~same, best_cost, torch.where(~better & ~same, torch.minimum(second_cost, cost), second_cost)
        )
        best = torch.where(better, column, best)
        best_cost = torch.minimum(best_cost, cost)
    settled = torch.isfinite(best_cost) & (second_cost > best_cost + 1.0) & (code.second_margin >= CERTAIN)
    fused = best if len(carriers) == 1 else _fuse(best, carriers, periods, steps)
    return torch.where(settled, fused, torch.nan)


def low_phase_error(carrier: torch.Tensor, column: torch.Tensor, period: float) -> torch.Tensor:
    """Measured minus predicted phase of a carrier at projector columns, wrapped to (-pi, pi], radians."""
    predicted = torch.polar(torch.ones_like(column), column * (2 * torch.pi / period))
    return torch.angle(carrier * predicted.conj())


def _candidates(
    in_fringe: torch.Tensor, code: GrayCode, gray_period: float, high_period: float
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """(distance outside the code's cell, column) for the three fringe orders nearest each admissible code word."""
    found = []
    doubtful = code.margin < CERTAIN
    for word, allowed in ((code.order, None), (code.rival, doubtful)):
        start = word * gray_period
        nearest = torch.round((start + 0.5 * gray_period - in_fringe) / high_period)
        for shift in (-1, 0, 1):
            column = in_fringe + (nearest + shift) * high_period
            outside = torch.maximum(start - column, column - start - gray_period).clamp(min=0.0)
            found.append((outside if allowed is None else torch.where(allowed, outside, torch.inf), column))
    return found


def _fuse(
    column: torch.Tensor, carriers: torch.Tensor, periods: tuple[float, ...], steps: tuple[int, ...]
) -> torch.Tensor:
    weights = [steps[c] * (carriers[c].abs() / periods[c]) ** 2 for c in range(2)]
    low_offset = low_phase_error(carriers[1], column, periods[1]) * (periods[1] / (2 * torch.pi))
    return column + low_offset * weights[1] / (weights[0] + weights[1]).clamp(min=1e-12)
