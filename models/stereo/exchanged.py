"""Are the views exchanged? Toed-in cameras match either way round; only one way agrees with the projector."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.geometry.rectification import rectify
from models.geometry.rig import Rig, Side
from models.phase.fringe import FringePhase
from models.stereo.matcher import PhaseMatcher
from models.stereo.rectified import rectify_phases

_ROW_STEP = 8
_CLEARLY_BETTER = 0.75
_FEWEST_MATCHES = 50


def views_look_exchanged(phases: Mapping[Side, FringePhase], rig: Rig, depth_range: tuple[float, float]) -> bool:
    """Whether left and right explain each other, and the projector where there is one, clearly better when exchanged.

    Compares, on every eighth row, the cost of each pixel's best candidate both ways round.
    """
    exchanged: dict[Side, FringePhase] = {"left": phases["right"], "right": phases["left"]}
    cost, count = _agreement(phases, rig, depth_range)
    other_cost, other_count = _agreement(exchanged, rig, depth_range)
    if other_count < _FEWEST_MATCHES:
        return False
    return count < 0.1 * other_count or other_cost < _CLEARLY_BETTER * cost


def _agreement(phases: Mapping[Side, FringePhase], rig: Rig, depth_range: tuple[float, float]) -> tuple[float, int]:
    """Mean cost of the best candidates and how many pixels have one."""
    matcher = PhaseMatcher("stereo" if rig.projector is None else "trinocular")
    views = {side: view.every(_ROW_STEP) for side, view in rectify_phases(phases, rectify(rig)).items()}
    candidates = matcher.candidates(views, phases["left"].periods, rig, depth_range, _ROW_STEP)
    matched = candidates.count > 0
    best = candidates.cost.min(axis=2, initial=np.inf)[matched]
    return (float(best.mean()) if best.size else np.inf), int(matched.sum())
