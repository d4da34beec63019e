"""Classes of scenes by their traits, and regions by the depth edges of the truth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.geometry.rig import Rig
from models.metrics import Reference, aggregate, classes_of, compare, depth_edges, near_edges, traits_of
from models.metrics.edges import STEP
from models.points import PointMap, Reason

SHAPE = (30, 40)
MIDDLE = 20
RANGE = (100.0, 2000.0)


def plane(slope_x: float, slope_y: float = 0.0, depth: float = 500.0) -> np.ndarray:
    """The plane z = depth + slope_x X + slope_y Y as a camera of 1000 px focal length sees it."""
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]] - np.array([SHAPE[0] / 2, SHAPE[1] / 2])[:, None, None]
    return (depth / (1 - (slope_x * x + slope_y * y) / 1000)).astype(np.float32)


def step(millimetres: float, slope: float = 0.0) -> np.ndarray:
    """A plane whose right half lies deeper."""
    depth = plane(slope)
    depth[:, MIDDLE:] += np.float32(millimetres)
    return depth


def columns(*marked: int) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[:, list(marked)] = True
    return mask


# Edges


@given(
    slope_x=st.floats(-15, 15), slope_y=st.floats(-15, 15), depth=st.floats(200, 2000)
)  # 15: a plane turned by 86 degrees
def test_no_plane_has_an_edge(slope_x, slope_y, depth):
    assert not depth_edges(plane(slope_x, slope_y, depth)).any()


def test_a_steep_plane_rises_by_more_than_an_edge_between_neighbours():
    """What the test above would not show if slopes were not taken off."""
    depth = plane(12.0)
    assert (np.abs(np.diff(depth, axis=1)) > STEP * depth[:, :-1]).any()


@pytest.mark.parametrize("slope", [0.0, 4.0, -4.0])
def test_a_step_is_an_edge_on_both_sides(slope):
    np.testing.assert_array_equal(depth_edges(step(20, slope)), columns(MIDDLE - 1, MIDDLE))
    np.testing.assert_array_equal(depth_edges(step(-20, slope)), columns(MIDDLE - 1, MIDDLE))


def test_edges_run_in_either_direction():
    wide = np.full((40, 40), 500.0)
    wide[:15] = 450
    rows = np.zeros((40, 40), bool)
    rows[14:16] = True
    np.testing.assert_array_equal(depth_edges(wide), rows)
    np.testing.assert_array_equal(depth_edges(wide.T), rows.T)


@pytest.mark.parametrize("depth", [250.0, 500.0, 1500.0])
def test_the_least_step_rises_with_the_depth(depth):
    for share, expected in ((0.8 * STEP, False), (1.2 * STEP, True)):
        stepped = np.full(SHAPE, depth)
        stepped[:, MIDDLE:] *= 1 + share
        assert depth_edges(stepped).any() == expected


def test_a_crease_is_no_edge():
    roof = np.maximum(plane(5.0), plane(-5.0))
    assert np.ptp(roof) > 30
    assert not depth_edges(roof).any()


def test_a_surface_against_nothing_is_an_edge_and_the_image_border_is_none():
    depth = plane(1.0)
    depth[:, MIDDLE:] = np.nan
    np.testing.assert_array_equal(depth_edges(depth), columns(MIDDLE - 1, MIDDLE))
    assert not depth_edges(np.full(SHAPE, np.nan)).any()


def test_a_bar_one_pixel_wide_is_an_edge():
    depth = plane(0.0)
    depth[:, MIDDLE] = 480
    np.testing.assert_array_equal(depth_edges(depth), columns(MIDDLE - 1, MIDDLE, MIDDLE + 1))


def test_the_limb_of_a_ball_is_an_edge_and_its_face_is_none():
    y, x = np.mgrid[-40:41, -40:41].astype(float)
    inside = x**2 + y**2 < 30**2
    ball = np.where(inside, 500 - np.sqrt(np.maximum(30.0**2 - x**2 - y**2, 0)), 600)
    edges = depth_edges(ball)
    assert not edges[x**2 + y**2 < 27**2].any()
    assert not edges[x**2 + y**2 > 33**2].any()
    assert edges[40, 10] or edges[40, 11]


# The band


def test_the_band_reaches_five_pixels_to_either_side():
    np.testing.assert_array_equal(near_edges(step(20)), columns(*range(MIDDLE - 5, MIDDLE + 5)))
    np.testing.assert_array_equal(near_edges(step(20), pixels=1), columns(MIDDLE - 1, MIDDLE))
    assert not near_edges(plane(3.0)).any()


def test_the_band_round_a_corner_is_round():
    depth = np.full((40, 40), 500.0)
    depth[20:, 20:] = 450
    band = near_edges(depth)
    assert band[15, 20]
    assert not band[15, 15]
    assert band[17, 17]  # the corner is at (19.5, 19.5); 2.5 px diagonally are 3.5 px


# Classes


@pytest.mark.parametrize(
    ("traits", "classes"),
    [
        ("", ("smooth", "isolated")),
        ("wall", ("smooth",)),
        ("dark glossy wall", ("glossy", "dark")),
        ("textured fine", ("fine", "isolated", "textured")),
        ("wall something-new", ("smooth",)),
    ],
)
def test_classes_of_traits(traits, classes):
    assert classes_of(traits.split()) == classes


def test_traits_of_a_capture_that_tells_them():
    assert traits_of({"traits": ["dark", "wall"]}) == {"dark", "wall"}
    assert traits_of({"traits": []}) == frozenset()


@pytest.mark.parametrize("settings", [{}, {"traits": None}, {"traits": "dark"}, {"traits": ["dark", 1]}])
def test_other_captures_have_none(settings):
    assert traits_of(settings) is None


# Errors of regions


def test_errors_of_the_band_and_of_the_rest_are_told_apart_and_add_up(rig):
    """5 mm off in the band on both sides of a step, 0.5 mm elsewhere, a corner invalid."""
    depth = step(30)
    band = near_edges(depth)
    error = np.where(band, 5.0, 0.5)
    points = np.stack([0 * depth, 0 * depth, depth + error], axis=-1).astype(np.float32)
    points[:10, :10] = np.nan
    mask = np.where(np.isnan(points[..., 2]), np.uint8(Reason.NO_MATCH), np.uint8(Reason.VALID))
    estimate = dataclasses.replace(PointMap.empty(SHAPE), points=points, mask=mask)
    whole = Reference(depth, np.full(SHAPE, np.nan), np.ones(SHAPE, bool))

    def errors_in(region: np.ndarray) -> object:
        return compare(estimate, whole.limited_to(region), Rig(rig.left, rig.right), 9.0, RANGE)

    near, rest = (aggregate([errors_in(region)]) for region in (band, ~band))
    assert (near.pixels, rest.pixels) == (10 * SHAPE[0], 30 * SHAPE[0])
    assert (near.mae_depth, near.within_1mm, near.within_3mm, near.valid) == (pytest.approx(5, rel=1e-4), 0, 0, 100)
    assert (rest.mae_depth, rest.valid) == (pytest.approx(0.5, rel=1e-3), pytest.approx(100 * (1 - 100 / 900)))

    parts, all_of_it = [errors_in(band), errors_in(~band)], errors_in(np.ones(SHAPE, bool))
    for field in dataclasses.fields(all_of_it):
        summed = sum(getattr(part, field.name) for part in parts)
        np.testing.assert_allclose(summed, getattr(all_of_it, field.name), rtol=1e-12, err_msg=field.name)
