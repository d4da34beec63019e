"""Pictures of results: their colours mean what their scales say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import DuofringeError
from service.figure import Panel, compose
from service.pictures import (
    INVALID_GREY,
    depth_scale,
    error_scale,
    grey_picture,
    phase_scale,
    shaded_picture,
    tight_range,
    write_picture,
)


def test_scale_ends_and_invalid_pixels() -> None:
    scale = depth_scale((400.0, 600.0))
    colours = scale.paint(np.array([[400.0, 600.0, 100.0, 900.0, np.nan]]))[0]
    bar = scale.bar(256, 3)
    assert np.array_equal(colours[0], bar[-1, 0])
    assert np.array_equal(colours[1], bar[0, 0])
    assert np.array_equal(colours[:2], colours[2:4])  # clipped
    assert (colours[4] == INVALID_GREY).all()


def test_errors_too_near_are_blue_and_too_far_are_red() -> None:
    near, exact, far = error_scale(1.0).paint(np.array([[-0.6, 0.0, 0.6]]))[0].astype(int)
    assert near[0] > near[2] + 40  # BGR
    assert far[2] > far[0] + 40
    assert exact.min() > 230


def test_phase_colours_join_at_the_wrap() -> None:
    below, above = phase_scale().paint(np.array([[np.pi - 1e-3, -np.pi + 1e-3]]))[0].astype(int)
    assert np.abs(below - above).max() < 6


def test_tight_range_ignores_stray_points_and_empty_maps() -> None:
    depth = np.linspace(450.0, 550.0, 10_000)
    depth[0], depth[1] = 9000.0, np.nan
    low, high = tight_range(depth)
    assert 449 <= low <= 452
    assert 548 <= high <= 551
    assert tight_range(np.full(3, np.nan)) == (0.0, 1.0)


def test_a_surface_facing_the_light_is_brighter() -> None:
    normals = np.array([[[0.0, -0.6, -0.8], [0.0, 0.6, -0.8], [np.nan] * 3]])
    up, down, none = shaded_picture(normals)[0].astype(int)
    assert up.mean() > down.mean() + 30
    assert (none == INVALID_GREY).all()


def test_camera_images_are_scaled_to_their_white_level() -> None:
    picture = grey_picture(np.array([[0, 2048, 4095]], np.uint16), 4095)
    assert picture[0, :, 0].tolist() == [0, 128, 255]


def test_figure_holds_each_panel_at_its_width(tmp_path: Path) -> None:
    red, blue = np.zeros((30, 40, 3), np.uint8), np.zeros((30, 40, 3), np.uint8)
    red[..., 2], blue[..., 0] = 255, 255
    figure = compose("Title", "Subtitle", [[Panel("a", red), Panel("b", blue, "caption", depth_scale((0, 1)))]], 200)
    for colour in ((0, 0, 255), (255, 0, 0)):
        assert (figure == colour).all(axis=2).sum() == 200 * 150
    write_picture(tmp_path / "figure.png", figure)
    assert np.array_equal(cv2.imread(str(tmp_path / "figure.png")), figure)
    with pytest.raises(DuofringeError, match="does not exist"):
        write_picture(tmp_path / "no" / "figure.png", figure)
