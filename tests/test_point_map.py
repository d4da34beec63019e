"""Refining, filling and rejecting: what is a point, where it stands, and why the rest is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ideal_phases import Patch, ideal_phases, surface_points

from models.geometry.projection import pack_projection
from models.geometry.rectification import rectify
from models.geometry.rig import Rig
from models.points import Origin, PointMap, Reason
from models.stereo.left_projector import intersect_columns
from models.stereo.matcher import Matching, PhaseMatcher
from models.stereo.point_map import RejectionSettings, build_point_map, projector_residual, smeared_edges

RANGE = (400.0, 670.0)
STEP = [Patch(560.0), Patch(470.0, x=(-40.0, 60.0), y=(-50.0, 50.0))]
"""A plate 100 mm square, 90 mm before a wall."""


def mapped(
    rig: Rig,
    patches: list[Patch],
    matching: Matching = "trinocular",
    depth_range: tuple[float, float] = RANGE,
    settings: RejectionSettings | None = None,
    **kwargs: float,
) -> tuple[PointMap, np.ndarray]:
    phases, truth = ideal_phases(rig, patches, **kwargs)  # type: ignore[arg-type]
    matches = PhaseMatcher(matching).match(phases, rig, depth_range)
    settings = settings or RejectionSettings(carrier_weights=(9.0, 14.0))
    points = build_point_map(phases, matches, rig, depth_range, settings, use_projector=matching == "trinocular")
    return points, truth


def depth_error(points: PointMap, truth: np.ndarray) -> np.ndarray:
    return np.abs(points.depth - truth[..., 2])[points.valid]


@pytest.mark.parametrize("matching", ["stereo", "trinocular"])
@pytest.mark.parametrize("columns", [False, True], ids=["wrapped", "absolute"])
def test_perfect_phases_give_nearly_perfect_points(rig: Rig, matching: Matching, columns: bool) -> None:
    points, truth = mapped(rig, [Patch(520.0, slope_x=0.3, slope_y=0.1)], matching, columns=columns)
    error = depth_error(points, truth)
    assert points.valid.mean() > 0.7
    assert np.median(error) < 0.02
    assert (error > 1).mean() < 0.05 if matching == "stereo" else (error > 1).mean() < 2e-3


def test_points_off_the_step_stand_on_one_side_of_it(rig: Rig) -> None:
    points, truth = mapped(rig, STEP, columns=True)
    assert (depth_error(points, truth) > 1).mean() < 2e-3
    for depth in (470.0, 560.0):
        here = np.abs(truth[..., 2] - depth) < 1
        assert points.valid[here].mean() > 0.6


def test_what_only_the_left_camera_sees_comes_from_the_projector(rig: Rig) -> None:
    """Beside the plate the right camera looks at the wall's hidden part; the projector still lights it here."""
    filled, truth = mapped(rig, STEP, "trinocular", columns=True)
    plain, _ = mapped(rig, STEP, "stereo", columns=True)
    assert (plain.origin != Origin.LEFT_PROJECTOR).all()
    extra = filled.origin == Origin.LEFT_PROJECTOR
    assert extra.sum() > 1000
    error = np.abs(filled.depth - truth[..., 2])
    assert np.median(error[extra]) < 0.01
    assert (error[extra] > 1).mean() < 5e-3
    assert len(filled) > len(plain)


@settings(max_examples=25)
@given(
    depth=st.floats(410.0, 660.0),
    x=st.integers(0, 639),
    y=st.integers(0, 479),
)
def test_a_line_of_sight_and_a_column_meet_where_they_should(rig: Rig, depth: float, x: int, y: int) -> None:
    assert rig.projector is not None
    ray = rig.left.rays(np.array([[[x, y]]], np.float64))
    point = ray * depth
    column = rig.projector.project(point)[..., 0].astype(np.float32)
    found = intersect_columns(
        column, np.ones((1, 1), np.bool_), ray, pack_projection(rig.projector), np.array([400.0, 670.0])
    )
    assert np.abs(found - point).max() < 0.02


def test_a_column_met_outside_the_range_gives_no_point(rig: Rig) -> None:
    assert rig.projector is not None
    ray = rig.left.rays(np.array([[[320.0, 240.0]]]))
    column = rig.projector.project(ray * 800.0)[..., 0].astype(np.float32)
    args = (np.ones((1, 1), np.bool_), ray, pack_projection(rig.projector), np.array([400.0, 670.0]))
    assert np.isnan(intersect_columns(column, *args)).all()
    assert np.isnan(intersect_columns(np.full((1, 1), np.nan, np.float32), *args)).all()


def test_points_outside_the_range_are_told_so(rig: Rig) -> None:
    points, truth = mapped(rig, [Patch(470.0), Patch(440.0, x=(-60.0, 40.0), y=(-40.0, 40.0))], depth_range=(455, 600))
    near = truth[..., 2] < 450
    assert points.valid[near].mean() < 0.002  # pixels of its edge are taken for the wall
    assert (points.mask[near] == Reason.OUT_OF_RANGE).mean() > 0.7
    # Wall beside the plate that the right camera cannot see may match an alias: wrapped phases cannot always tell.
    assert (depth_error(points, truth) > 1).mean() < 0.02


def test_a_lone_patch_is_isolated(rig: Rig) -> None:
    small = Patch(500.0, x=(-4.0, 4.0), y=(-4.0, 4.0))
    points, truth = mapped(rig, [small])
    seen = np.isfinite(truth[..., 2])
    assert 100 < seen.sum() < RejectionSettings().smallest_surface
    assert len(points) == 0
    assert (points.mask[seen] == Reason.ISOLATED).mean() > 0.5
    kept, _ = mapped(rig, [small], settings=RejectionSettings(smallest_surface=20))
    assert len(kept) > 0.5 * seen.sum()


def test_views_that_disagree_with_the_projector_are_refused(rig: Rig) -> None:
    phases, _ = ideal_phases(rig, [Patch(500.0)])
    turned = {side: replace(p, carriers=p.carriers * np.exp(2.0j)) for side, p in phases.items()}
    believed, refused = (
        build_point_map(
            views, PhaseMatcher("stereo").match(views, rig, RANGE), rig, RANGE, RejectionSettings(), use_projector=True
        )
        for views in (phases, turned)
    )
    assert len(believed) > 100_000
    assert len(refused) < 0.02 * len(believed)
    assert (refused.mask[believed.valid] == Reason.AMBIGUOUS).mean() > 0.9


def test_reasons_of_the_phases_are_kept(rig: Rig) -> None:
    phases, _ = ideal_phases(rig, [Patch(500.0)])
    mask = phases["left"].mask.clone()
    mask[100:150, 200:300] = int(Reason.SATURATED)
    mask[300:320, 200:300] = int(Reason.LOW_MODULATION)
    phases["left"] = replace(phases["left"], mask=mask)
    matches = PhaseMatcher("trinocular").match(phases, rig, RANGE)
    points = build_point_map(phases, matches, rig, RANGE, RejectionSettings(), use_projector=True)
    assert (points.mask[100:150, 200:300] == Reason.SATURATED).all()
    assert (points.mask[300:320, 200:300] == Reason.LOW_MODULATION).all()


def test_confidence_falls_with_noise(rig: Rig) -> None:
    quiet, noisy = (mapped(rig, [Patch(500.0)], noise=n)[0] for n in (0.01, 0.3))
    assert np.median(noisy.confidence[noisy.valid]) < np.median(quiet.confidence[quiet.valid]) <= 1


def test_residual_is_the_phase_that_the_projector_does_not_explain(rig: Rig) -> None:
    phases, truth = ideal_phases(rig, [Patch(500.0, slope_x=0.2)])
    assert np.nanmax(np.abs(projector_residual(truth, phases["left"], rig))) < 1e-3
    later = replace(phases["left"], carriers=phases["left"].carriers * np.exp(0.5j))
    assert np.nanmedian(projector_residual(truth, later, rig)) == pytest.approx(0.5, abs=1e-3)
    assert np.isnan(projector_residual(np.full_like(truth, np.nan), phases["left"], rig)).all()


def test_smeared_pixels_at_an_edge_are_dropped_and_clean_ones_kept() -> None:
    disparity = np.full((60, 80), 100.0)
    disparity[:, 40:] = 130.0
    clean, smeared = np.full((60, 80), 0.1, np.float32), np.full((60, 80), 2.0, np.float32)
    assert not smeared_edges(disparity, clean, RejectionSettings()).any()
    dropped = smeared_edges(disparity, smeared, RejectionSettings())
    assert dropped[:, 38:42].any(axis=1).all()
    assert not dropped[:, :30].any()
    assert not dropped[:, 50:].any()
    disparity[20:30, 60:70] = np.nan
    at_rim = smeared_edges(disparity, smeared, RejectionSettings())
    assert at_rim[19, 60:70].all()
    assert not at_rim[22:28, 62:68].any()


def test_misfit_lowers_the_confidence(rig: Rig) -> None:
    phases, _ = ideal_phases(rig, [Patch(500.0)])
    misfit = torch.full((480, 640), 0.05)
    misfit[:, 320:] = 0.8
    phases = {side: replace(p, misfit=misfit) for side, p in phases.items()}
    matches = PhaseMatcher("trinocular").match(phases, rig, RANGE)
    points = build_point_map(phases, matches, rig, RANGE, RejectionSettings(), use_projector=True)
    sure, unsure = points.confidence[:, 60:250], points.confidence[:, 400:600]
    assert np.median(unsure[unsure > 0]) < 0.8 * np.median(sure[sure > 0])


def test_the_truth_helper_agrees_with_the_rig(rig: Rig) -> None:
    """Points seen by the right camera and by the left are the same surface."""
    patch = Patch(500.0, slope_x=0.3)
    points = surface_points([patch], rig.right)
    assert np.abs(points[..., 2] - 500 - 0.3 * points[..., 0]).max() < 1e-9
    assert np.abs(rig.right.project(points) - rig.right.pixel_grid()).max() < 1e-6
    rectification = rectify(rig)
    left, right = (rectification.canvas_coordinates(side, points[::50, ::50]) for side in ("left", "right"))
    back = rectification.triangulate(left[..., 0], right[..., 0], left[..., 1])
    assert np.abs(back - points[::50, ::50]).max() < 1e-6
