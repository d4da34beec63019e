"""The reference method: N-step phases, made absolute by Gray planes where the capture has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch

from models.capture import Capture
from models.geometry.rig import Side
from models.patterns import PatternKind
from models.phase.absolute_column import UnwrapTolerance, absolute_column
from models.phase.fringe import FringePhase
from models.phase.gray_code import decode_gray
from models.phase.phase_shift import demodulate
from models.points import Reason

SATURATION = 0.998
"""Share of full scale at and above which a pixel counts as saturated."""


@dataclass(frozen=True)
class NStepSettings:
    """minimum_modulation: share of full scale below which a phase is noise. minimum_light: of white minus black."""

    minimum_modulation: float = 0.005
    minimum_light: float = 0.010
    tolerance: UnwrapTolerance = field(default_factory=UnwrapTolerance)


class NStep:
    """``PhaseExtractor`` for phase-shifted captures; see ``FringePhase`` for what it returns."""

    name = "nstep"

    def __init__(self, settings: NStepSettings | None = None, device: torch.device | str = "cpu") -> None:
        self.settings = settings or NStepSettings()
        self.device = torch.device(device)

    def required_kinds(self) -> frozenset[PatternKind]:
        return frozenset({"high"})

    def extract(self, capture: Capture) -> Mapping[Side, FringePhase]:
        capture.require(self.required_kinds(), "method nstep")
        return {side: self._view(capture, side) for side in capture.sides}

    def _view(self, capture: Capture, side: Side) -> FringePhase:
        plan = capture.plan
        kinds: list[PatternKind] = ["high", "low"] if plan.of_kind("low") else ["high"]
        stacks = {kind: self._stack(capture, side, kind) for kind in kinds}
        carriers = torch.stack([demodulate(stacks[kind], plan.of_kind(kind)) for kind in kinds])
        periods = tuple(plan.of_kind(kind)[0].periods[0] for kind in kinds)
        extremes: dict[PatternKind, torch.Tensor | None] = {
            kind: self._stack(capture, side, kind)[0] if plan.of_kind(kind) else None for kind in ("white", "black")
        }
        column = None
        if plan.of_kind("gray"):
            inverse = self._stack(capture, side, "gray_inv") if plan.of_kind("gray_inv") else None
            planes = self._stack(capture, side, "gray")
            black = _true_black(extremes["black"], stacks["high"], planes)
            code = decode_gray(planes, inverse=inverse, white=extremes["white"], black=black)
            steps = tuple(len(plan.of_kind(kind)) for kind in kinds)
            gray_period = plan.of_kind("gray")[0].periods[0]
            column = absolute_column(carriers, periods, steps, code, gray_period, self.settings.tolerance)
        mask = self._mask(carriers, stacks, extremes)
        return FringePhase(carriers, stacks["high"].mean(dim=0), mask, periods, column=column)

    def _stack(self, capture: Capture, side: Side, kind: PatternKind) -> torch.Tensor:
        return torch.from_numpy(capture.stack(side, kind)).to(self.device)

    def _mask(
        self,
        carriers: torch.Tensor,
        stacks: Mapping[PatternKind, torch.Tensor],
        extremes: Mapping[PatternKind, torch.Tensor | None],
    ) -> torch.Tensor:
        mask = torch.zeros(carriers.shape[1:], dtype=torch.uint8, device=self.device)
        mask[(carriers.abs() < self.settings.minimum_modulation).any(dim=0)] = Reason.LOW_MODULATION
        white, black = extremes["white"], extremes["black"]
        if white is not None and black is not None:
            # An ambient-light frame taken for black (see _true_black) must not make lit pixels count as unlit.
            mask[white - torch.minimum(black, stacks["high"].mean(dim=0)) < self.settings.minimum_light] = Reason.UNLIT
        brightest = torch.stack([stack.amax(dim=0) for stack in stacks.values()]).amax(dim=0)
        mask[brightest >= SATURATION] = Reason.SATURATED
        return mask


def _true_black(black: torch.Tensor | None, fringes: torch.Tensor, planes: torch.Tensor) -> torch.Tensor:
    """Level (H, W) of a dark Gray stripe: the black frame, or the darkest of the other frames where that is no black.

    A frame without projector light is darker than the fringes' mean. Recorded sets exist whose unlit frame was taken
    with the room's lamps on and is brighter than many lit ones; a threshold from it would flip Gray bits.
    """
    darkest = torch.minimum(fringes.amin(dim=0), planes.amin(dim=0))
    return darkest if black is None else torch.where(black < fringes.mean(dim=0), black, darkest)
