"""What a pattern looks like when it leaves the projector, and where points fall on a device."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulator.geometry import reference_rig
from drivers.simulator.optics import (
    PROFILE_STEPS,
    Optics,
    blur_image,
    footprint_offsets,
    gather,
    pattern_profile,
    project_points,
)
from models.geometry.device import Device
from models.patterns import LIGHTCRAFTER_4500, FringeParameters, Raster, make_pattern

SQUARE = Raster(912, 1140, "square")
RASTERS = pytest.mark.parametrize("raster", [LIGHTCRAFTER_4500, SQUARE], ids=["diamond", "square"])


def at(profile, coordinate):
    """Light of a profile at coordinates, as the cameras look it up."""
    coordinate = np.atleast_1d(np.asarray(coordinate, np.float32))
    one = np.ones((len(coordinate), 1), np.float32)
    return gather(one, coordinate[:, None], profile, np.zeros(len(coordinate), np.float32))


@RASTERS
def test_white_is_even_inside_and_dark_outside(raster):
    white = pattern_profile(make_pattern("white"), raster, Optics())
    assert at(white, np.linspace(6, 905, 4000)) == pytest.approx(1.0, abs=1e-5)
    assert at(white, [-7.0, 918.0]) == pytest.approx(0.0, abs=1e-5)


@RASTERS
def test_black_leaks_by_the_contrast(raster):
    black = pattern_profile(make_pattern("black"), raster, Optics(contrast=600))
    assert at(black, np.linspace(6, 905, 50)) == pytest.approx(1 / 600, rel=1e-4)


@RASTERS
@pytest.mark.parametrize(("name", "period"), [("high_00", 9.0), ("low_00", 14.0)])
def test_defocus_and_mirror_shape_lower_the_contrast_as_they_should(raster, name, period):
    """The fringe keeps its phase; its amplitude falls by the Gaussian's and the aperture's transfer functions."""
    profile = pattern_profile(make_pattern(name), raster, Optics(defocus_columns=0.7))
    u = np.arange(126 * 16) / 16 + 90  # whole periods
    light = at(profile, u)
    z = 2 * np.mean(light * np.exp(2j * np.pi * u / period))
    transfer = np.exp(-2 * (np.pi * 0.7 / period) ** 2)
    transfer *= np.sinc(0.5 / period) ** 2 if raster.kind == "diamond" else np.sinc(1 / period)
    assert abs(z) == pytest.approx(0.5 * transfer * (1 - 1 / 600), rel=2e-3)
    assert abs(np.angle(z)) < 1e-3


@RASTERS
def test_row_patterns_vary_along_v_with_the_same_blur_on_the_object(raster):
    pattern = make_pattern("row_high_00", FringeParameters(row_periods=(18.0, 28.0)))
    rows_per_column = 2.0 if raster.kind == "diamond" else 1.0
    profile = pattern_profile(pattern, raster, Optics(), rows_per_column)
    assert profile.row_coded
    v = np.arange(126 * 16) / 16 + 90
    z = 2 * np.mean(at(profile, v) * np.exp(2j * np.pi * v / 18))
    transfer = np.exp(-2 * (np.pi * 0.7 * rows_per_column / 18) ** 2)
    transfer *= np.sinc(1 / 18) ** 2 if raster.kind == "diamond" else np.sinc(1 / 18)
    assert abs(z) == pytest.approx(0.5 * transfer * (1 - 1 / 600), rel=2e-3)
    assert abs(np.angle(z)) < 1e-3


def test_gray_edges_lie_between_the_mirrors():
    """On the square raster a plane changes at 9n - 0.5; on the diamond the mean of 9n - 0.5 and 9n."""
    plane = make_pattern("gray_06")  # changes at orders 1, 3, 5 ...
    for raster, edge in ((SQUARE, 8.5), (LIGHTCRAFTER_4500, 8.75)):
        profile = pattern_profile(plane, raster, Optics())
        u = np.linspace(7, 10.5, 3501)
        crossing = u[np.argmin(np.abs(at(profile, u) - (0.5 + 0.5 / 600)))]
        assert crossing == pytest.approx(edge, abs=0.01)


def test_patterns_are_quantised_to_8_bits_before_projection():
    sharp = Optics(defocus_columns=0.0, contrast=1e9)
    profile = pattern_profile(make_pattern("composite"), SQUARE, sharp)
    shown = make_pattern("composite").render(Raster(912, 1, "square"))[0]
    assert np.allclose(at(profile, np.arange(912)) * 255, shown, atol=1e-4)


def test_profile_is_fine_enough():
    """Linear interpolation between samples against a profile evaluated on the samples of twice the blur's detail."""
    profile = pattern_profile(make_pattern("gray_06"), SQUARE, Optics())
    nodes = profile.light.astype(np.float64)
    curvature = np.abs(np.diff(nodes, 2)).max()
    assert curvature / 8 * 255 < 0.02
    assert len(nodes) > 912 * PROFILE_STEPS


devices = st.builds(
    lambda k, p, s, tilt: Device(
        (640, 480),
        [[900, 0, 310], [0, 950, 250], [0, 0, 1]],
        [k[0], k[1], p, -p, k[2], 0.01, 0.0, 0.0, s, 0.0, -s, 0.0, tilt, -tilt],
        reference_rig().right.rotation,
        reference_rig().right.translation,
    ),
    st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    st.floats(-0.005, 0.005),
    st.floats(-0.01, 0.01),
    st.sampled_from([0.0, 0.02]),
)


@given(devices, st.integers(0, 1000))
def test_fast_projection_is_the_devices_own(device, seed):
    points = np.random.default_rng(seed).uniform([-150, -100, 300], [250, 100, 700], (40, 3))
    assert np.allclose(project_points(device, points), device.project(points), atol=2e-4)  # float32 of some 640 px


def test_points_behind_a_device_have_no_pixel():
    assert np.isnan(project_points(reference_rig().left, np.array([[0.0, 0.0, -500.0]]))).all()


@pytest.mark.parametrize("footprint", [1, 2, 3])
def test_footprint_is_centred_and_even(footprint):
    offsets = footprint_offsets(footprint)
    assert offsets.shape == (footprint**2, 2)
    assert np.allclose(offsets.mean(axis=0), 0)
    assert np.ptp(offsets, axis=0) == pytest.approx([1 - 1 / footprint] * 2)


def test_lens_blur_has_the_asked_width_and_keeps_the_light():
    image = np.zeros((21, 21), np.float32)
    image[10, 10] = 1
    blurred = blur_image(image, 0.4)
    assert blurred.sum() == pytest.approx(1, abs=1e-5)
    x = np.arange(21) - 10
    assert np.sqrt((blurred.sum(axis=0) * x**2).sum()) == pytest.approx(0.4, abs=1e-3)
    assert blur_image(image, 0.0) is image
