"""Images on the mirrors give the light of the patterns that they were made from."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_scenes import box_before_wall

from drivers.simulator.optics import Optics, Profile
from drivers.simulator.projected import Picture, light_of
from drivers.simulator.rig import SimulatedRig
from models.geometry.rig import SIDES
from models.patterns import LIGHTCRAFTER_4500, Raster, make_pattern

SQUARE = Raster(912, 1140, "square")


@pytest.fixture(scope="module")
def observation():
    return SimulatedRig().observe(box_before_wall())


@pytest.mark.parametrize("name", ["composite", "high_03", "gray_02", "white", "black", "row_high_01", "row_gray_03"])
def test_a_rendered_pattern_lights_the_scene_as_the_pattern_does(observation, name):
    pattern = make_pattern(name)
    levels = pattern.render(LIGHTCRAFTER_4500)
    for side in SIDES:
        expected = observation.light(side, pattern)
        assert np.abs(observation.light_of_image(side, levels) - expected).max() < 1e-5


def test_a_picture_falls_where_its_mirrors_point(observation):
    """White in one corner of the mirrors: light there, dark elsewhere, and the whole in between."""
    levels = np.zeros((1140, 912), np.uint8)
    levels[300:700, 200:500] = 255
    assert isinstance(light_of(levels, LIGHTCRAFTER_4500, Optics(), 2.0), Picture)
    view = observation.views["left"]
    white = observation.light("left", make_pattern("white"))
    light = observation.light_of_image("left", levels)
    u, v = view.columns[..., 0], view.rows[..., 0]
    lit = np.all(view.gain > 0, axis=2)
    inside = lit & (np.abs(u - 350) < 140) & (np.abs(v - 500) < 180)
    outside = lit & ((np.abs(u - 350) > 160) | (np.abs(v - 500) > 220))
    assert inside.sum() > 5_000
    assert outside.sum() > 5_000
    assert np.quantile(np.abs(light[inside] - white[inside]), 0.99) < 0.01
    dark = observation.light("left", None)
    assert np.quantile(np.abs(light[outside] - dark[outside]), 0.99) < 0.01


@pytest.mark.parametrize("raster", [LIGHTCRAFTER_4500, SQUARE], ids=["diamond", "square"])
def test_pictures_and_profiles_agree_on_a_fringe(raster):
    """One odd mirror makes a fringe a picture; elsewhere its light is that of the fringe."""
    optics = Optics()
    levels = make_pattern("high_00").render(raster)
    rows_per_column = 2.0 if raster.kind == "diamond" else 1.0
    profile = light_of(levels, raster, optics, rows_per_column)
    assert isinstance(profile, Profile)
    odd = levels.copy()
    odd[0, 0] ^= 255
    picture = light_of(odd, raster, optics, rows_per_column)
    assert isinstance(picture, Picture)
    columns = np.arange(100, 800, 1 / picture.per_column, dtype=np.float32)[None]
    seen = picture.at(columns, np.full_like(columns, 600.0))[0]
    steps = np.arange(len(profile.light))
    expected = np.interp((columns[0] - profile.start) * 32, steps, profile.light)
    # mirrors as points of a lattice, not as areas: the picture keeps a little more contrast
    assert np.abs(seen - expected).max() < 0.03


def test_a_picture_ends_with_its_mirrors():
    levels = np.full((1140, 912), 255, np.uint8)
    levels[5, 5] = 0
    picture = light_of(levels, LIGHTCRAFTER_4500, Optics(), 2.0)
    assert isinstance(picture, Picture)
    places = np.array([[-20.0, 450.0, 940.0]], np.float32)
    assert picture.at(places, np.full_like(places, 600.0))[0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-3)
