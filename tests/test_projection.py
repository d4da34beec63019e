"""The compiled projection is OpenCV's, for every length of distortion vector."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.geometry.device import DISTORTION_TERMS, Device
from models.geometry.projection import pack_projection, project_points

SCALES = np.array([0.2, 0.1, 5e-3, 5e-3, 0.05, 0.1, 0.05, 0.02, 5e-3, 5e-3, 5e-3, 5e-3, 0.05, 0.05])


def turned(x: float, y: float, z: float) -> np.ndarray:
    """Rotation matrix by angles about the three axes, rad."""
    (cx, sx), (cy, sy), (cz, sz) = ((np.cos(a), np.sin(a)) for a in (x, y, z))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @ about_y @ about_x


@given(
    terms=st.sampled_from(DISTORTION_TERMS),
    shares=st.lists(st.floats(-1, 1), min_size=14, max_size=14),
    angles=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    shift=st.tuples(*[st.floats(-200, 200)] * 3),
    seed=st.integers(0, 1000),
)
def test_agrees_with_the_device(terms, shares, angles, shift, seed) -> None:  # type: ignore[no-untyped-def]
    matrix = np.array([[1086.0, 0, 455.75], [0, 2172, 569.5], [0, 0, 1]])
    device = Device((912, 1140), matrix, (SCALES * shares)[:terms], turned(*angles), np.array(shift), name="projector")
    rng = np.random.default_rng(seed)
    local = np.column_stack([rng.uniform(-0.3, 0.3, (50, 2)), np.ones(50)]) * rng.uniform(300, 900, (50, 1))
    points = (local - device.translation) @ device.rotation
    expected = device.project(points)
    shown = np.isfinite(expected).all(axis=1)
    assert np.abs(project_points(pack_projection(device), points) - expected)[shown].max(initial=0) < 1e-6


@pytest.mark.parametrize("terms", DISTORTION_TERMS)
def test_every_length_moves_the_pixels(terms: int) -> None:
    """Guards the property above: each vector's last terms do something."""
    matrix = np.array([[1000.0, 0, 320], [0, 1000, 240], [0, 0, 1]])
    point = np.array([[160.0, 120.0, 500.0]])
    distortion = np.zeros(terms)
    distortion[-1] = 0.05
    bent, straight = (Device((640, 480), matrix, d) for d in (distortion, np.zeros(terms)))
    moved = project_points(pack_projection(bent), point) - project_points(pack_projection(straight), point)
    assert np.abs(moved).max() > 1e-3


def test_points_behind_have_no_pixel() -> None:
    device = Device((640, 480), np.array([[1000.0, 0, 320], [0, 1000, 240], [0, 0, 1]]), np.zeros(5))
    pixels = project_points(pack_projection(device), np.array([[0.0, 0, -500], [0, 0, 0], [0, 0, 500]]))
    assert np.isnan(pixels[:2]).all()
    assert pixels[2] == pytest.approx([320, 240])
