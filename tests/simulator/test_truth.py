"""Ground truth against geometry that is known by hand, and against the rendered images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from simulated_scenes import box_before_wall, slab, target, thing

from drivers.simulator.geometry import reference_rig
from drivers.simulator.mix import random_scene
from drivers.simulator.optics import Optics
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from drivers.simulator.sensor import Sensor
from models.geometry.rig import Rig
from models.patterns import FringeParameters, Raster, make_plan

EXACT = Sensor(bit_depth=12, noiseless=True)
STEPS = make_plan("reference").restricted_to([f"high_{k:02d}" for k in range(9)])


@pytest.fixture(scope="module")
def simulated() -> SimulatedRig:
    return SimulatedRig(sensor=EXACT)


@pytest.fixture(scope="module", params=["diamond", "square"])
def mixed_capture(request):
    """A scene of the default mix, with a wall, on both kinds of raster."""
    rig = SimulatedRig(reference_rig(request.param), sensor=EXACT)
    scene = next(s for s in (random_scene(0, i) for i in range(12)) if s.traits == {"wall"})
    return rig.render(scene, STEPS)


def test_depth_of_a_plane_is_its_own(simulated):
    truth = simulated.render(target(depth=520.0), STEPS.restricted_to([])).truth
    assert truth.depth.dtype == np.float32
    assert np.abs(truth.depth - 520.0).max() < 1e-3


def test_back_projected_depth_meets_the_projector_column(mixed_capture):
    rig, truth = mixed_capture.rig, mixed_capture.truth
    points = rig.left.back_project(rig.left.pixel_grid(), truth.depth)
    mirrors = rig.projector.project(points)
    known = np.isfinite(truth.projector_column)
    assert known.mean() > 0.5
    assert np.abs(mirrors[known][:, 0] - truth.projector_column[known]).max() < 1e-3
    assert np.abs(mirrors[known][:, 1] - truth.extra["projector_row"][known]).max() < 2e-3
    assert truth.foreground[~known].sum() == 0


def phase_error_columns(capture, stack, coordinate, period) -> np.ndarray:
    steps = len(stack)
    z = np.tensordot(np.exp(2j * np.pi * np.arange(steps) / steps), stack, 1)
    error = np.angle(z * np.exp(-2j * np.pi * coordinate / period)) * period / (2 * np.pi)
    return error[capture.truth.foreground]


def test_decoded_phase_agrees_with_the_truth(mixed_capture):
    error = phase_error_columns(
        mixed_capture, mixed_capture.stack("left", "high"), mixed_capture.truth.projector_column, 9
    )
    assert np.median(np.abs(error)) < 0.005
    assert np.percentile(np.abs(error), 90) < 0.02
    assert abs(np.median(error)) < 5e-4


def test_decoded_row_phase_agrees_with_the_truth(simulated):
    plan = make_plan("calibration")
    plan = plan.restricted_to(p.name for p in plan.of_kind("row_low"))
    capture = simulated.render(random_scene(0, 1), plan)
    error = phase_error_columns(capture, capture.stack("left", "row_low"), capture.truth.extra["projector_row"], 28)
    assert np.median(np.abs(error)) < 0.02
    assert abs(np.median(error)) < 2e-3


def test_right_view_shows_the_same_columns(simulated):
    """Truth is on the left grid; a foreground point looked up in the right image has the column's phase there too."""
    capture = simulated.render(target(depth=540.0, albedo=0.6), STEPS)
    rig, truth = capture.rig, capture.truth
    rows, columns = np.nonzero(truth.foreground)
    pick = np.random.default_rng(0).choice(len(rows), 4000, replace=False)
    points = rig.left.back_project(np.stack([columns, rows], -1)[pick], truth.depth[rows, columns][pick])
    seen = np.rint(rig.right.project(points)).astype(int)
    inside = ((seen > 2) & (seen < [637, 477])).all(axis=1)
    x, y = seen[inside].T
    z = np.tensordot(np.exp(2j * np.pi * np.arange(9) / 9), capture.stack("right", "high")[:, y, x], 1)
    # the column of the plane's point in the nearest pixel's centre, not of the point itself
    rays = rig.right.rays(np.stack([x, y], -1).astype(float))
    centre = rig.right.centre
    on_plane = centre + rays * ((540.0 - centre[2]) / rays[:, 2])[:, None]
    expected = rig.projector.project(on_plane)[:, 0]
    error = np.angle(z * np.exp(-2j * np.pi * expected / 9)) * 9 / (2 * np.pi)
    assert np.median(np.abs(error)) < 0.005


def test_plate_shadows_the_wall_where_the_projector_says(simulated):
    """A wall point is in shadow exactly where its line to the lens crosses the plate."""
    capture = simulated.render(box_before_wall(), make_plan("full").restricted_to(["white", "black"]))
    truth = capture.truth
    points = capture.rig.left.back_project(capture.rig.left.pixel_grid(), truth.depth)
    lens = capture.rig.projector.centre
    crossing = lens + (points - lens) * ((450.0 - lens[2]) / (points[..., 2] - lens[2]))[..., None]
    margin = 40.0 - np.abs(crossing[..., :2]).max(axis=-1)  # the plate's half size
    on_wall = truth.extra["object_index"] == 1
    clear = np.abs(margin) > 1.0  # the plate is 2 mm thick
    shadowed = on_wall & (margin > 0) & clear
    open_ = on_wall & (margin < 0) & clear & np.isfinite(truth.projector_column)
    assert shadowed.sum() > 1000
    assert not truth.extra["lit"][shadowed].any()
    assert truth.extra["lit"][open_].mean() > 0.995
    white, black = (capture.images["left"][n].astype(float) for n in ("white", "black"))
    away = cv2.erode(on_wall.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0  # the blur reaches over the silhouette
    assert np.abs(white - black)[away & (margin > 3.0)].max() == 0
    assert (white - black)[on_wall & (margin < -3) & truth.extra["lit"]].min() > 255


def test_plate_hides_the_wall_from_the_right_camera(simulated):
    truth = simulated.render(box_before_wall(), STEPS.restricted_to([])).truth
    rig = simulated.rig
    points = rig.left.back_project(rig.left.pixel_grid(), truth.depth)
    eye = rig.right.centre
    crossing = eye + (points - eye) * ((450.0 - eye[2]) / (points[..., 2] - eye[2]))[..., None]
    margin = 40.0 - np.abs(crossing[..., :2]).max(axis=-1)
    on_wall = truth.extra["object_index"] == 1
    hidden = on_wall & (margin > 1.0)
    assert hidden.sum() > 500
    assert not truth.extra["covisible"][hidden].any()
    inside = rig.right.contains(rig.right.project(points))
    assert truth.extra["covisible"][on_wall & (margin < -1.0) & inside].mean() > 0.995
    assert not truth.extra["covisible"][~inside].any()


def test_foreground_is_lit_covisible_and_in_range(simulated):
    for depth, share in ((380.0, 0.0), (420.0, 0.5), (660.0, 0.5), (690.0, 0.0)):
        truth = simulated.render(target(depth=depth), STEPS.restricted_to([])).truth
        expected = truth.extra["lit"] & truth.extra["covisible"] & (400 <= depth <= 670)
        assert np.array_equal(truth.foreground, expected)
        assert truth.foreground.mean() >= share
        assert np.isfinite(truth.depth).all()  # depth is told out of range, too


def test_nothing_is_nowhere(simulated):
    capture = simulated.render(Scene(()), STEPS)
    assert np.isnan(capture.truth.depth).all()
    assert np.isnan(capture.truth.projector_column).all()
    assert not capture.truth.foreground.any()
    assert capture.images["left"]["high_00"].max() <= round(4095 / 255) + 1


def test_pixels_at_a_silhouette_are_partly_covered():
    """A pixel averages over its footprint: covered shares come in steps of 1/9 and add up to the plate's width."""
    fine = SimulatedRig(optics=Optics(footprint=3))
    scene = Scene((thing(slab(500.0, (121.3, 121.3)), albedo=0.8),))
    covered = fine.observe(scene).views["left"].albedo[240] / 0.8
    assert np.allclose(covered * 9, np.rint(covered * 9), atol=1e-4)
    edges = fine.rig.left.project(np.array([[-60.65, 0.8, 500.0], [60.65, 0.8, 500.0]]))
    assert covered.sum() == pytest.approx(edges[1, 0] - edges[0, 0], abs=1 / 3)


def test_working_range_is_the_rigs(simulated):
    rig = simulated.rig
    near = Rig(rig.left, rig.right, rig.projector, rig.raster, {"working_range_mm": [300, 450]})
    truth = SimulatedRig(near).render(target(depth=500.0), STEPS.restricted_to([])).truth
    assert not truth.foreground.any()


def test_smaller_raster_lights_a_smaller_field(simulated):
    """Outside the raster there is no light, and no column."""
    rig = simulated.rig
    narrow_device = type(rig.projector)(
        (400, 500),
        [[rig.projector.fx, 0, 199.5], [0, rig.projector.fy, 249.5], [0, 0, 1]],
        rig.projector.distortion,
        rig.projector.rotation,
        rig.projector.translation,
    )
    narrow = SimulatedRig(Rig(rig.left, rig.right, narrow_device, Raster(400, 500, "diamond"), rig.quality))
    parameters = FringeParameters(raster=Raster(400, 500, "diamond"))
    capture = narrow.render(target(), make_plan("full", parameters).restricted_to(["white"]))
    lit = capture.truth.extra["lit"]
    assert 0.05 < lit.mean() < 0.5
    assert np.array_equal(np.isfinite(capture.truth.projector_column), lit)
    assert capture.images["left"]["white"][240, 20] <= 6  # ambient light only
