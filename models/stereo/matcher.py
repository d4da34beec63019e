"""Phase-based stereo matching in two modes: the two cameras alone, or with the projector's vote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from models.geometry.projection import pack_projection
from models.geometry.rectification import Rectification, rectify
from models.geometry.rig import Rig, Side
from models.phase.fringe import FringePhase
from models.points import Reason
from models.stereo.absolute import match_columns
from models.stereo.aggregate import PATHS, aggregate, cheapest
from models.stereo.candidates import Candidates, CandidateSettings, find_candidates
from models.stereo.rectified import RectifiedView, rectify_phases

Float32Array = npt.NDArray[np.float32]
Matching = Literal["stereo", "trinocular"]
MATCHINGS: tuple[Matching, ...] = ("stereo", "trinocular")


@dataclass(frozen=True, eq=False)
class CanvasMatches:
    """Matches of the left canvas (h, w): right canvas column (float32, NaN where none) and the reason where none.

    cost: float32, of the chosen candidate (0 for absolute matches). margin: float32, by how much the runner-up
    is dearer a path; inf where there is none. right: the right view on its canvas, in which the matches lie.
    """

    x_right: Float32Array
    reason: npt.NDArray[np.uint8]
    cost: Float32Array
    margin: Float32Array
    right: RectifiedView


class Matcher(Protocol):
    """Finds for each left canvas pixel the point of the right canvas that shows the same phases."""

    name: Matching

    def match(self, phases: Mapping[Side, FringePhase], rig: Rig, depth_range: tuple[float, float]) -> CanvasMatches:
        """Match two views; the phases' columns are used where both views have them (reference captures)."""
        ...


@dataclass(frozen=True)
class MatcherSettings:
    """How candidates are chosen.

    jump_cost: of changing the fringe along a path. ambiguity: a runner-up dearer by less makes a pixel ambiguous.
    range_margin: share of the depth range, in inverse depth, searched beyond either end, so that what stands outside
    is found there and not mistaken for an alias inside. Only with the projector: the pair alone has too many aliases.
    """

    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    jump_cost: float = 6.0
    ambiguity: float = 0.1
    range_margin: float = 0.3


class PhaseMatcher:
    """Both modes: ``stereo`` compares the views, ``trinocular`` also what the projector shows at each candidate."""

    def __init__(self, name: Matching, settings: MatcherSettings | None = None) -> None:
        self.name = name
        self.settings = settings or MatcherSettings()

    def match(self, phases: Mapping[Side, FringePhase], rig: Rig, depth_range: tuple[float, float]) -> CanvasMatches:
        views = rectify_phases(phases, rectify(rig))
        left, right = views["left"], views["right"]
        if left.column is not None and right.column is not None:
            return _match_absolute(left, right, rectify(rig), depth_range, self._projection(rig))
        return self._choose(self.candidates(views, phases["left"].periods, rig, depth_range), left, right)

    def candidates(
        self,
        views: Mapping[Side, RectifiedView],
        periods: tuple[float, ...],
        rig: Rig,
        depth_range: tuple[float, float],
        row_step: int = 1,
    ) -> Candidates:
        """Match candidates by wrapped phases alone; the views may hold only every ``row_step``-th canvas row."""
        left, right = views["left"], views["right"]
        projector = self._projection(rig)
        if projector.size > 0:
            depth_range = _widened(depth_range, self.settings.range_margin)
        s = self.settings.candidates
        scales = np.array(
            [s.low_scale, s.high_scale, s.projector_low_scale, s.texture_weight, s.misfit_scale, s.surplus]
        )
        limit = min(s.limit, _most_candidates(right, rectify(rig), depth_range))
        frame, turn = kernel_frame(rectify(rig), row_step)
        found = find_candidates(
            left.phase, right.phase, left.usable, right.usable, left.texture, right.texture,
            left.misfit, right.misfit, frame, turn, np.array(depth_range), projector, np.array(periods), scales, limit,
            right.direction,
        )  # fmt: skip
        return Candidates(*found)

    def _projection(self, rig: Rig) -> npt.NDArray[np.float64]:
        return pack_projection(rig.projector) if self.name == "trinocular" and rig.projector else np.zeros(0)

    def _choose(self, candidates: Candidates, left: RectifiedView, right: RectifiedView) -> CanvasMatches:
        total = aggregate(candidates, self.settings.jump_cost)
        index, surplus = cheapest(total, candidates.count)
        margin = surplus / np.float32(PATHS)
        reason = np.full(left.usable.shape, int(Reason.NO_MATCH), np.uint8)
        reason[candidates.count > 0] = int(Reason.VALID)
        reason[(candidates.count > 0) & (margin < self.settings.ambiguity)] = int(Reason.AMBIGUOUS)
        x_right = np.take_along_axis(candidates.x_right, index[..., None], axis=2)[..., 0]
        cost = np.take_along_axis(candidates.cost, index[..., None], axis=2)[..., 0]
        x_right = np.where(reason == int(Reason.VALID), x_right, np.float32(np.nan))
        return CanvasMatches(x_right, reason, cost, margin, right)


def _widened(depth_range: tuple[float, float], margin: float) -> tuple[float, float]:
    near, far = 1 / depth_range[0], 1 / depth_range[1]
    reach = margin * (near - far)
    return 1 / (near + reach), 1 / max(far - reach, 0.2 * far)


def _match_absolute(
    left: RectifiedView,
    right: RectifiedView,
    rectification: Rectification,
    depth_range: tuple[float, float],
    projector: npt.NDArray[np.float64],
) -> CanvasMatches:
    assert left.column is not None
    assert right.column is not None
    frame, turn = kernel_frame(rectification)
    x_right, reason = match_columns(
        left.column, right.column, left.usable, right.usable, frame, turn, np.array(depth_range), projector,
        right.direction,
    )  # fmt: skip
    nothing = np.zeros(x_right.shape, np.float32)
    return CanvasMatches(x_right, reason, nothing, np.full_like(nothing, np.inf), right)


def kernel_frame(
    rectification: Rectification, row_step: int = 1
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The ``frame`` of ``find_candidates`` and the rotation from the rectified to the left-camera frame."""
    r = rectification
    frame = np.array([r.focal, r.baseline, r.cx["left"], r.cx["right"], r.cy, row_step])
    return frame, np.ascontiguousarray(r.rotation.T)


def _most_candidates(right: RectifiedView, rectification: Rectification, depth_range: tuple[float, float]) -> int:
    """How many fringes fit into the search range, with room for steep ones."""
    span = rectification.focal * rectification.baseline * (1 / depth_range[0] - 1 / depth_range[1])
    steps = right.phase_steps()
    if steps.size == 0:
        return 1
    fastest = max(float(np.percentile(right.direction * steps, 90)), 0.05)
    return int(np.ceil(1.25 * span * fastest / (2 * np.pi))) + 2
