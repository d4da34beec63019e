"""Projection and back-projection of one device, against each other and against the model's own equations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.errors import CalibrationError
from models.geometry.device import DISTORTION_TERMS, Device

MATRIX = [[1000.0, 0, 319.5], [0, 1010, 239.5], [0, 0, 1]]
LIMITS = [0.15, 0.05, 2e-3, 2e-3, 0.02, 0.05, 0.02, 0.01, 2e-3, 1e-3, 2e-3, 1e-3, 0.02, 0.02]
"""Size of each distortion term that keeps the lens model invertible over the field."""


def turned(axis: tuple[float, float, float]) -> np.ndarray:
    """Rotation by |axis| radians about ``axis``, from Rodrigues' formula."""
    angle = float(np.linalg.norm(axis))
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(axis) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@st.composite
def devices(draw: st.DrawFn) -> Device:
    terms = draw(st.sampled_from(DISTORTION_TERMS))
    distortion = [draw(st.floats(-limit, limit)) for limit in LIMITS[:terms]]
    axis = draw(st.tuples(*[st.floats(-0.4, 0.4)] * 3))
    translation = draw(st.tuples(*[st.floats(-200, 200)] * 3))
    return Device((640, 480), MATRIX, distortion, turned(axis), translation)


PIXELS = st.lists(st.tuples(st.floats(0, 639), st.floats(0, 479)), min_size=1, max_size=16).map(np.array)


@given(device=devices(), pixels=PIXELS, depth=st.floats(50, 5000))
def test_back_projected_pixels_project_to_themselves(device, pixels, depth):
    points = device.back_project(pixels, np.full(len(pixels), depth))
    np.testing.assert_allclose(device.project(points), pixels, atol=1e-5)
    local = points @ device.rotation.T + device.translation
    np.testing.assert_allclose(local[:, 2], depth, rtol=1e-9)


@given(device=devices(), pixels=PIXELS, depth=st.floats(50, 5000))
def test_points_lie_on_the_rays_through_the_centre(device, pixels, depth):
    points = device.back_project(pixels, np.full(len(pixels), depth))
    across = np.cross(points - device.centre, device.rays(pixels))
    np.testing.assert_allclose(across, 0, atol=1e-7 * depth)


@given(device=devices(), points=st.lists(st.tuples(*[st.floats(-300, 300)] * 3), min_size=1, max_size=8).map(np.array))
def test_points_behind_or_beside_the_device_are_nan(device, points):
    points = (points - (0, 0, 301) - device.translation) @ device.rotation
    assert np.isnan(device.project(points)).all()


def test_projection_follows_the_lens_equations():
    k1, k2, p1, p2, k3 = distortion = [-0.1, 0.02, 1e-3, -2e-3, 0.01]
    device = Device((640, 480), MATRIX, distortion)
    x, y = 0.21, -0.14
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = 1000 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 319.5
    v = 1010 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 239.5
    np.testing.assert_allclose(device.project([x * 500, y * 500, 500]), [u, v], atol=1e-9)


@given(devices())
def test_the_centre_of_projection_maps_to_the_origin_of_the_device(device):
    np.testing.assert_allclose(device.rotation @ device.centre + device.translation, 0, atol=1e-9)


def test_shapes_follow_the_input():
    device = Device((8, 6), MATRIX, np.zeros(5))
    grid = device.pixel_grid()
    assert grid.shape == (6, 8, 2)
    np.testing.assert_array_equal(grid[2, 5], [5, 2])
    assert device.back_project(grid, np.ones((6, 8))).shape == (6, 8, 3)
    assert device.project(np.empty((0, 3))).shape == (0, 2)
    assert device.undistort(np.empty((0, 2))).shape == (0, 2)
    assert device.project([0, 0, 1]).shape == (2,)


def test_nan_goes_through_as_nan():
    device = Device((640, 480), MATRIX, [-0.1, 0, 0, 0, 0])
    assert np.isnan(device.project([np.nan, 0, 500])).all()
    assert np.isnan(device.undistort([np.nan, 3.0])).any()
    np.testing.assert_array_equal(device.contains([[np.nan, 3], [3, 3]]), [False, True])


def test_the_border_of_half_a_pixel_belongs_to_the_sensor():
    device = Device((640, 480), MATRIX, np.zeros(4))
    assert device.contains([[-0.5, -0.5], [639.5, 479.5]]).all()
    assert not device.contains([[-0.51, 0], [0, 479.51]]).any()


def test_a_lens_that_folds_back_does_not_show_far_points_on_the_sensor():
    device = Device((640, 480), MATRIX, [-0.1, 0, 0, 0, 0])
    assert device.fold_radius == pytest.approx(np.sqrt(1 / 0.3), abs=2e-3)
    x = np.linspace(0, 5, 200)
    pixels = device.project(np.stack([x, 0 * x, 1 + 0 * x], axis=-1) * 500)
    seen = device.contains(pixels)
    assert seen.any()
    assert x[seen].max() < 0.35
    assert np.isnan(pixels[x > 2]).all()
    assert Device((640, 480), MATRIX, np.zeros(5)).fold_radius == np.inf


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"matrix": np.zeros((3, 3))}, "matrix is singular"),
        ({"matrix": np.full((3, 3), np.nan)}, "matrix contains NaN"),
        ({"matrix": np.eye(4)}, "matrix has shape"),
        ({"matrix": [[1000, 3, 320], [0, 1000, 240], [0, 0, 1]]}, "skew"),
        ({"matrix": [[-1000, 0, 320], [0, 1000, 240], [0, 0, 1]]}, "fx, fy > 0"),
        ({"matrix": [["1000", "0", "3"]] * 3}, "matrix is not an array of numbers"),
        ({"matrix": [[1], [1, 2]]}, "matrix is not an array of numbers"),
        ({"matrix": None}, "matrix is not an array of numbers"),
        ({"matrix": [10**400] * 9}, "matrix is not an array of numbers"),
        ({"distortion": [0, 0, 0]}, "distortion has 3 terms"),
        ({"distortion": []}, "distortion has 0 terms"),
        ({"distortion": [np.inf, 0, 0, 0]}, "distortion contains NaN or infinite"),
        ({"rotation": 2 * np.eye(3)}, "rotation is not a rotation"),
        ({"rotation": np.diag([1, 1, -1])}, "rotation is not a rotation"),
        ({"translation": [1, 2]}, "translation has shape"),
        ({"translation": [np.nan, 0, 0]}, "translation contains NaN"),
        ({"size": (0, 480)}, "size must be"),
        ({"size": (640, 10**9)}, "size must be"),
        ({"size": (640,)}, "size must be"),
    ],
)
def test_values_that_no_device_has_are_refused_by_name(changed, named):
    values = {"size": (640, 480), "matrix": MATRIX, "distortion": np.zeros(5), "name": "left", **changed}
    with pytest.raises(CalibrationError, match=f"^left: .*{named}") as caught:
        Device(**values)
    assert "\n" not in str(caught.value)


def test_arrays_cannot_be_changed_from_outside():
    matrix = np.array(MATRIX)
    device = Device((640, 480), matrix, np.zeros(5))
    matrix[0, 0] = 1
    assert device.fx == 1000
    with pytest.raises(ValueError, match="read-only"):
        device.matrix[0, 0] = 1
