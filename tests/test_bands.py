"""Bands from the rig hold the frequencies that its cameras see; bands from a spectrum find the carriers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_captures import objects_before_wall, plate_before_wall

from models.capture import Capture
from models.geometry.device import Device
from models.geometry.rig import Rig, Side
from models.phase.bands import carrier_bands, fringe_field, spectral_field
from models.phase.nstep import NStep

PERIODS = (9.0, 14.0)


def measured_frequencies(capture: Capture, side: Side, carrier: int) -> np.ndarray:
    """(n, 2) rad/px along x and y of a reference phase, where the surface is smooth."""
    phase = NStep().extract(capture)[side]
    field = phase.carriers[carrier].numpy()
    step_x = np.angle(field[1:-1, 2:] * field[1:-1, :-2].conj()) / 2
    step_y = np.angle(field[2:, 1:-1] * field[:-2, 1:-1].conj()) / 2
    strong = np.abs(field) > 0.05
    smooth = strong[1:-1, 2:] & strong[1:-1, :-2] & strong[2:, 1:-1] & strong[:-2, 1:-1]
    return np.stack([step_x[smooth], step_y[smooth]], axis=-1)


@pytest.mark.parametrize("scene", [objects_before_wall, plate_before_wall], ids=["objects", "plates"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_reference_bands_hold_what_the_cameras_see(scene, side: Side) -> None:  # type: ignore[no-untyped-def]
    capture: Capture = scene()
    rig = capture.rig
    assert rig is not None
    field = fringe_field(rig, rig.cameras[side], rig.working_depths)
    assert field is not None
    assert field.sign == 1
    bands = carrier_bands(field, PERIODS)
    for carrier, band in enumerate(bands):
        zeta, eta = measured_frequencies(capture, side, carrier).T
        slack = 0.04  # rad/px, below a window's own width in frequency
        held = (zeta > band.zeta[0] - slack) & (zeta < band.zeta[1] + slack)
        held &= (eta > band.eta[0] - slack) & (eta < band.eta[1] + slack)
        assert held.mean() > 0.93
        assert band.zeta[0] < np.median(zeta) < band.zeta[1]


def test_bands_of_two_carriers_do_not_overlap(rig: Rig) -> None:
    field = fringe_field(rig, rig.left, (400.0, 670.0))
    assert field is not None
    high, low = carrier_bands(field, PERIODS)
    assert 0 < low.zeta[0] < low.zeta[1] <= high.zeta[0] < high.zeta[1] < math.pi


def test_a_single_carrier_keeps_its_whole_range(rig: Rig) -> None:
    field = fringe_field(rig, rig.left, (400.0, 670.0))
    assert field is not None
    (band,) = carrier_bands(field, (9.0,))
    assert band.zeta == pytest.approx((field.zeta[0] / 9, field.zeta[2] / 9))


def test_a_mirrored_projector_turns_the_sign(rig: Rig) -> None:
    assert rig.projector is not None
    upside_down = np.diag([-1.0, -1.0, 1.0])
    p = rig.projector
    turned = Device(p.size, p.matrix, p.distortion, upside_down @ p.rotation, upside_down @ p.translation)
    plain, mirrored = (
        fringe_field(Rig(rig.left, rig.right, device, rig.raster), rig.left, (400.0, 670.0)) for device in (p, turned)
    )
    assert plain is not None
    assert mirrored is not None
    assert (plain.sign, mirrored.sign) == (1, -1)
    assert mirrored.zeta[1] == pytest.approx(plain.zeta[1], rel=0.1)


def test_no_projector_no_field(rig: Rig) -> None:
    assert fringe_field(Rig(rig.left, rig.right), rig.left, (400.0, 670.0)) is None


@settings(max_examples=15)
@given(columns_per_px=st.floats(0.75, 1.4), tilt=st.floats(-0.15, 0.15), seed=st.integers(0, 100))
def test_spectrum_tells_the_base_frequency(columns_per_px: float, tilt: float, seed: int) -> None:
    y, x = np.mgrid[0:240, 0:320]
    column = columns_per_px * x + tilt * y
    texture = 0.4 + 0.1 * np.sin(x / 40) * np.cos(y / 30)
    image = texture * (1 + 0.5 * np.cos(2 * np.pi * column / 9) + 0.5 * np.cos(2 * np.pi * column / 14))
    image += np.random.default_rng(seed).normal(0, 0.01, image.shape)
    field = spectral_field(image.astype(np.float32), PERIODS)
    assert field.zeta[1] == pytest.approx(2 * math.pi * columns_per_px, rel=0.04)
    assert field.zeta[0] < field.zeta[1] < field.zeta[2]


def test_spectrum_agrees_with_the_rig_on_a_simulated_scene() -> None:
    capture = plate_before_wall()
    rig = capture.rig
    assert rig is not None
    geometry = fringe_field(rig, rig.left, rig.working_depths)
    assert geometry is not None
    seen = spectral_field(capture.stack("left", "composite")[0], PERIODS)
    assert seen.zeta[1] == pytest.approx(geometry.zeta[1], rel=0.15)
