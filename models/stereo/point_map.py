"""From canvas matches to the organised point map: refine, triangulate, doubt, reject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from models.geometry.projection import pack_projection, project_points
from models.geometry.rectification import rectify
from models.geometry.rig import Rig, Side
from models.normals import estimate_normals
from models.phase.fringe import FringePhase
from models.points import Origin, PointMap, Reason
from models.stereo.grown import contradicted, grow_columns
from models.stereo.left_projector import intersect_columns
from models.stereo.matcher import CanvasMatches
from models.stereo.sensor_grid import refine_on_sensor
from models.stereo.surfaces import claimed_twice, label_surfaces

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
_TWO_PI = 2 * np.pi
_STEEPEST_COLUMNS = 6.0
"""Largest difference of projector columns within 3x3 pixels of one surface."""
_UNCONFIRMED = 0.7
"""Doubt of a point that only one camera saw; its confidence is at most one half."""


@dataclass(frozen=True)
class RejectionSettings:
    """When a match is not believed.

    low: rad the low phases of the two views may differ by at the match. projector: rad the high phase may differ from
    the one the projector shows at the point. smallest_surface:
    pixels; smaller connected surfaces are dropped. step: px of disparity within which neighbouring pixels are one
    surface. claim: px of disparity within which two pixels may share a right pixel. jump, jump_reach, jump_misfit: px
    of disparity that make an occluding edge, px from it within which, and misfit above which, a match may be the other
    surface's smeared phase. rim_reach, rim_misfit: likewise at any rim of what matched. carrier_weights: relative
    inverse phase variance of (high, low) when the match is refined. growth: pixels by which surfaces grow into pixels
    without a match by their own phases and the projector. growth_tolerance, growth_misfit: rad by which these phases
    may contradict one another or those of the right view, and largest misfit of such a pixel.
    """

    low: float = 2.0
    projector: float = 1.2
    smallest_surface: int = 400
    step: float = 1.0
    claim: float = 2.5
    jump: float = 5.0
    jump_reach: float = 2.0
    jump_misfit: float = 0.5
    rim_reach: float = 2.0
    rim_misfit: float = 1.5
    carrier_weights: tuple[float, float] = (1.0, 0.0)
    growth: int = 8
    growth_tolerance: float = 0.5
    growth_misfit: float = 0.35


def build_point_map(
    phases: Mapping[Side, FringePhase],
    matches: CanvasMatches,
    rig: Rig,
    depth_range: tuple[float, float],
    settings: RejectionSettings,
    *,
    use_projector: bool,
) -> PointMap:
    """Point map on the left sensor's grid; every pixel without a trustworthy point names its reason.

    phases: of both views. matches: of the left canvas. depth_range: mm of left-camera z. use_projector: also require
    that the projector shows each point the phase that the left camera saw there.
    """
    left = phases["left"]
    canvas = rectify(rig).canvas_of_left.astype(np.float64)
    wrapped = left.wrapped.cpu().numpy()
    modulation = left.modulation.cpu().numpy()
    mask = left.mask.cpu().numpy().astype(np.uint8)
    column = None if left.column is None else left.column.cpu().numpy()
    usable = mask == Reason.VALID
    if column is not None:
        usable &= np.isfinite(column)
    x_right, low = refine_on_sensor(
        matches.x_right, rectify(rig).canvas_of_left, wrapped, modulation, usable,
        matches.right.phase, matches.right.usable, np.array(settings.carrier_weights[: len(wrapped)]),
    )  # fmt: skip
    points = rectify(rig).triangulate(canvas[..., 0], x_right, canvas[..., 1])
    reason = _inherited_reasons(mask, matches, canvas)
    reason[np.isfinite(x_right)] = Reason.VALID
    origin = np.where(np.isfinite(x_right), Origin.LEFT_RIGHT, Origin.NONE).astype(np.uint8)
    residual = np.zeros(mask.shape)
    if use_projector and rig.projector is not None:
        residual = projector_residual(points, left, rig)
        if column is not None:
            wanted = usable & ~np.isfinite(x_right) & inside_surface(np.where(usable, column, np.nan))
            filled = _fill_from_projector(points, column, wanted, rig, depth_range)
            reason[filled], origin[filled], residual[filled] = Reason.VALID, Origin.LEFT_PROJECTOR, 0.0
            x_right[filled] = rectify(rig).canvas_coordinates("right", points[filled])[:, 0]
    quality = (low / settings.low) ** 2 + (residual / settings.projector) ** 2
    quality[origin == Origin.LEFT_PROJECTOR] += _UNCONFIRMED
    misfit = None if left.misfit is None else left.misfit.cpu().numpy()
    if misfit is not None:
        quality += misfit**2
    _reject(reason, x_right, origin, points, low, residual, quality, misfit, matches, canvas, depth_range, settings)
    if use_projector and column is None and len(wrapped) > 1 and settings.growth:
        grown = _grow(reason, points, wrapped, usable, misfit, matches, left.periods, rig, depth_range, settings)
        reason[grown], origin[grown], quality[grown] = Reason.VALID, Origin.LEFT_PROJECTOR, _UNCONFIRMED
    valid = reason == Reason.VALID
    kept = np.where(valid[..., None], points, np.nan).astype(np.float32)
    confidence = np.where(valid, np.exp(-quality), 0.0).astype(np.float32)
    phase = np.where(valid, wrapped % _TWO_PI, np.nan).astype(np.float32)
    return PointMap(
        points=kept,
        normals=estimate_normals(kept),
        confidence=confidence,
        intensity=left.texture.cpu().numpy().astype(np.float32),
        modulation=modulation[0].astype(np.float32),
        phase_high=phase[0],
        phase_low=phase[1] if len(phase) > 1 else np.full_like(phase[0], np.nan),
        origin=np.where(valid, origin, Origin.NONE).astype(np.uint8),
        mask=reason,
    )


def inside_surface(column: Float32Array) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) whose 3x3 neighbours all have a column and differ by less than ``_STEEPEST_COLUMNS``.

    Pixels on an edge mix two surfaces; with one camera nothing else tells. column: NaN where unknown.
    """
    known = np.isfinite(column)
    square = np.ones((3, 3), np.uint8)
    largest = cv2.dilate(np.where(known, column, np.float32(1e6)), square)
    smallest = cv2.erode(np.where(known, column, np.float32(-1e6)), square)
    return np.asarray(largest - smallest < _STEEPEST_COLUMNS)


def _fill_from_projector(
    points: Float64Array,
    column: Float32Array,
    wanted: npt.NDArray[np.bool_],
    rig: Rig,
    depth_range: tuple[float, float],
) -> npt.NDArray[np.bool_]:
    """Put points of left camera and projector into ``points`` where wanted and possible; returns where, bool (H, W)."""
    assert rig.projector is not None
    rays = rectify(rig).left_rays()
    found = intersect_columns(column, wanted, rays, pack_projection(rig.projector), np.array(depth_range))
    filled = np.isfinite(found[..., 2])
    points[filled] = found[filled]
    return np.asarray(filled)


def _grow(
    reason: npt.NDArray[np.uint8],
    points: Float64Array,
    wrapped: Float32Array,
    usable: npt.NDArray[np.bool_],
    misfit: Float32Array | None,
    matches: CanvasMatches,
    periods: tuple[float, ...],
    rig: Rig,
    depth_range: tuple[float, float],
    settings: RejectionSettings,
) -> npt.NDArray[np.bool_]:
    """Put points of left camera and projector beside accepted ones into ``points``; returns where, bool (H, W)."""
    assert rig.projector is not None
    accepted = reason == Reason.VALID
    seen = project_points(pack_projection(rig.projector), points.reshape(-1, 3))[:, 0].reshape(accepted.shape)
    turns = wrapped[0].astype(np.float64) / _TWO_PI
    column = np.where(accepted, periods[0] * (turns + np.rint(seen / periods[0] - turns)), np.nan)
    wanted = usable & ~accepted
    if misfit is not None:
        wanted &= misfit <= settings.growth_misfit
    high, low = wrapped[0].astype(np.float64), wrapped[1].astype(np.float64)
    grown = grow_columns(column, wanted, high, low, np.array(periods), settings.growth_tolerance, settings.growth)
    found = np.full_like(points, np.nan)
    filled = _fill_from_projector(found, grown.astype(np.float32), np.isfinite(grown), rig, depth_range)
    place = rectify(rig).canvas_coordinates("right", found)
    limits = np.full(len(wrapped), settings.growth_tolerance)
    filled &= ~contradicted(
        place[..., 0], place[..., 1], filled, wrapped, matches.right.phase, matches.right.usable, limits
    )
    points[filled] = found[filled]
    return np.asarray(filled)


def _reject(
    reason: npt.NDArray[np.uint8],
    x_right: Float64Array,
    origin: npt.NDArray[np.uint8],
    points: Float64Array,
    low: Float32Array,
    residual: Float64Array,
    quality: Float64Array,
    misfit: Float32Array | None,
    matches: CanvasMatches,
    canvas: Float64Array,
    depth_range: tuple[float, float],
    settings: RejectionSettings,
) -> None:
    """Enter into ``reason`` why matches are not believed; see ``RejectionSettings``. All arrays are (H, W)."""
    matched = np.isfinite(x_right)
    with np.errstate(invalid="ignore"):
        outside = matched & ~((points[..., 2] >= depth_range[0]) & (points[..., 2] <= depth_range[1]))
        doubtful = matched & ~((np.abs(low) <= settings.low) & (np.abs(residual) <= settings.projector))
    believed = np.where(matched & ~outside & ~doubtful, x_right, np.nan)
    height, width = matches.right.usable.shape
    seen_right = np.where(origin == Origin.LEFT_RIGHT, believed, np.nan)
    twice = claimed_twice(
        canvas[..., 0], seen_right, canvas[..., 1], quality.astype(np.float32), height, width, settings.claim
    )
    disparity = np.where(twice, np.nan, believed - canvas[..., 0])
    smeared = np.zeros_like(twice) if misfit is None else smeared_edges(disparity, misfit, settings)
    disparity[smeared] = np.nan
    labels, sizes = label_surfaces(disparity, settings.step)
    small = (labels >= 0) & (np.append(sizes, 0)[labels] < settings.smallest_surface)
    reason[doubtful | twice | smeared] = Reason.AMBIGUOUS
    reason[small] = Reason.ISOLATED
    reason[outside] = Reason.OUT_OF_RANGE


def smeared_edges(disparity: Float64Array, misfit: Float32Array, settings: RejectionSettings) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) near an occluding edge or a rim whose image the fringes do not explain.

    A windowed method carries a bright surface's fringes a few pixels over the edge of a darker one.
    disparity: px, NaN where there is no match.
    """
    matched = np.isfinite(disparity)
    filled = disparity.astype(np.float32)
    square = np.ones((3, 3), np.uint8)
    nearest = cv2.dilate(np.where(matched, filled, np.float32(-1e6)), square)
    farthest = cv2.erode(np.where(matched, filled, np.float32(1e6)), square)
    jump = matched & (nearest - farthest > settings.jump)
    from_jump = cv2.distanceTransform((~jump).astype(np.uint8), cv2.DIST_L2, 5)
    from_rim = cv2.distanceTransform(matched.astype(np.uint8), cv2.DIST_L2, 5)
    at_jump = (from_jump < settings.jump_reach) & (misfit > settings.jump_misfit)
    at_rim = (np.minimum(from_rim, from_jump) < settings.rim_reach) & (misfit > settings.rim_misfit)
    return np.asarray(matched & (at_jump | at_rim))


def projector_residual(points: Float64Array, view: FringePhase, rig: Rig) -> Float64Array:
    """High phase of a view minus the one the projector shows at its points, wrapped rad (H, W); NaN without a point."""
    assert rig.projector is not None
    column = project_points(pack_projection(rig.projector), points.reshape(-1, 3))[:, 0].reshape(points.shape[:2])
    difference = view.wrapped[0].cpu().numpy() - _TWO_PI / view.periods[0] * column
    return np.asarray((difference + np.pi) % _TWO_PI - np.pi)


def _inherited_reasons(
    mask: npt.NDArray[np.uint8], matches: CanvasMatches, canvas: Float64Array
) -> npt.NDArray[np.uint8]:
    """The left view's own reasons, and the canvas's where the view had none."""
    height, width = matches.reason.shape
    x = np.clip(np.rint(canvas[..., 0]).astype(np.intp), 0, width - 1)
    y = np.clip(np.rint(canvas[..., 1]).astype(np.intp), 0, height - 1)
    seen = matches.reason[y, x]
    seen = np.where(seen == Reason.VALID, np.uint8(Reason.NO_MATCH), seen)
    return np.where(mask == Reason.VALID, seen, mask).astype(np.uint8)
