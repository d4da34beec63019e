"""Single-shot phases: against the simulator's own columns, and what leakage, edges, offsets and signs do to them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import torch
from simulated_captures import exposed, objects_before_wall, only, plate_before_wall

from models.capture import Capture, CaptureRecord
from models.geometry.rig import Rig
from models.patterns import Pattern, PatternPlan
from models.phase.bands import carrier_bands, fringe_field
from models.phase.fringe import FringePhase
from models.phase.wft import WftSettings, WindowedFourierTransform, separate
from models.points import Reason

PERIODS = (9.0, 14.0)


@lru_cache(maxsize=4)
def extracted(capture: Capture) -> FringePhase:
    return WindowedFourierTransform(capture.rig).extract(capture)["left"]


def phase_errors(capture: Capture, phase: FringePhase) -> np.ndarray:
    """(2, n) absolute phase errors, rad, on the foreground that the method keeps."""
    assert capture.truth is not None
    column = capture.truth.projector_column
    kept = capture.truth.foreground & np.isfinite(column) & (phase.mask.numpy() == Reason.VALID)
    expected = np.stack([np.exp(2j * np.pi * column[kept] / p) for p in phase.periods])
    return np.abs(np.angle(phase.carriers.numpy()[:, kept] * expected.conj()))


@pytest.mark.parametrize("scene", [objects_before_wall, plate_before_wall], ids=["objects", "plates"])
def test_phases_of_simulated_scenes(scene) -> None:  # type: ignore[no-untyped-def]
    capture: Capture = scene()
    phase = extracted(capture)
    assert capture.truth is not None
    assert (phase.mask.numpy() == Reason.VALID)[capture.truth.foreground].mean() > 0.9
    high, low = phase_errors(capture, phase)
    assert np.median(high) < 0.25
    assert np.median(low) < 0.2
    assert (high < np.pi / 2).mean() > 0.85


def composite_capture(column: np.ndarray, gain: np.ndarray | float = 0.6, **pattern: object) -> Capture:
    """One view of one composite exposure at the given columns (H, W), ten bits."""
    shot = Pattern.model_validate({"name": "composite", "kind": "composite", "period": PERIODS, **pattern})
    image = np.rint(1023 * np.clip(0.02 + gain * shot.evaluate(column) / 255, 0, 1)).astype(np.uint16)
    record = CaptureRecord(bit_depth=10)
    return Capture(PatternPlan(patterns=(shot,)), {"left": {"composite": image}}, record=record)


def plane_columns(slope: float = 1.05, tilt: float = 0.1) -> np.ndarray:
    y, x = np.mgrid[0:240, 0:320].astype(float)
    return slope * x + tilt * y


def test_phases_of_a_plane_and_their_amplitudes() -> None:
    column = plane_columns()
    phase = WindowedFourierTransform().extract(composite_capture(column))["left"]
    for carrier, period in zip(phase.carriers.numpy(), PERIODS, strict=True):
        error = np.angle(carrier * np.exp(-2j * np.pi * column / period))[30:-30, 30:-30]
        assert np.abs(error).max() < 0.25
        assert np.median(np.abs(error)) < 0.12
        assert np.median(np.abs(carrier)) == pytest.approx(0.6 * 63.75 / 255, rel=0.2)
    assert np.median(phase.texture.numpy()) == pytest.approx(0.02 + 0.3, abs=0.01)


@pytest.mark.parametrize("offsets", [(0.7, -2.1), (math.pi, 1.0)])
def test_offsets_of_the_pattern_are_taken_off(offsets: tuple[float, float]) -> None:
    column = plane_columns()
    phase = WindowedFourierTransform().extract(composite_capture(column, phase_offset=offsets))["left"]
    for carrier, period in zip(phase.carriers.numpy(), PERIODS, strict=True):
        error = np.angle(carrier * np.exp(-2j * np.pi * column / period))[30:-30, 30:-30]
        assert np.abs(error).max() < 0.25
        assert np.median(np.abs(error)) < 0.12


def test_phase_falls_where_the_projector_column_does(rig: Rig) -> None:
    """A projector upside down: the rig says so, and the phase falls along x although an image cannot tell."""
    assert rig.projector is not None
    flip = np.diag([-1.0, -1.0, 1.0])
    turned = replace(
        rig.projector, rotation=flip @ rig.projector.rotation, translation=flip @ rig.projector.translation
    )
    upside_down = Rig(rig.left, rig.right, turned, rig.raster)
    points = rig.left.back_project(rig.left.pixel_grid(), np.full((480, 640), 520.0))
    column = turned.project(points)[..., 0]
    assert np.diff(column[240]).mean() < -0.5
    phase = WindowedFourierTransform(upside_down, (400.0, 670.0)).extract(composite_capture(column))["left"]
    for carrier, period in zip(phase.carriers.numpy(), PERIODS, strict=True):
        error = np.angle(carrier * np.exp(-2j * np.pi * column / period))[40:-40, 40:-40]
        assert np.median(np.abs(error)) < 0.15


def test_rounds_cancel_the_leakage_between_the_carriers() -> None:
    capture = objects_before_wall()
    rig = capture.rig
    assert rig is not None
    phase = {
        rounds: WindowedFourierTransform(rig, settings=replace(WftSettings(), rounds=rounds)).extract(capture)["left"]
        for rounds in (1, WftSettings().rounds)
    }
    one, several = (np.median(phase_errors(capture, p), axis=1) for p in phase.values())
    assert several[0] < 0.85 * one[0]
    assert several[1] < 1.25 * one[1]  # the low band hears little of the high carrier


def test_leakage_on_a_flat_surface_is_gone_after_the_rounds(rig: Rig) -> None:
    """Known truth, no noise: what is left in the phases is the other carrier's leakage."""
    column = plane_columns(1.08, 0.0)
    image = torch.from_numpy(composite_capture(column).stack("left", "composite"))
    field = fringe_field(rig, rig.left, (400.0, 670.0))
    assert field is not None
    settings = WftSettings()
    errors = {}
    for rounds in (1, settings.rounds):
        carriers, _ = separate(
            image, carrier_bands(field, PERIODS), [3.5, 5.5], 12, replace(settings, rounds=rounds, first_relative=0.2)
        )
        error = np.angle(carriers[0].numpy() * np.exp(-2j * np.pi * column / 9))[30:-30, 30:-30]
        errors[rounds] = np.sqrt((error**2).mean())
    assert errors[settings.rounds] < 0.5 * errors[1]


@pytest.mark.parametrize("gain", [0.25, 0.7])
def test_exposure_scales_the_modulation_not_the_phase(gain: float) -> None:
    capture = only(plate_before_wall(), {"composite"})
    dim = extracted(exposed(capture, gain))
    full = extracted(capture)
    both = (dim.mask == Reason.VALID) & (full.mask == Reason.VALID)
    assert both.float().mean() > 0.8
    turn = torch.angle(dim.carriers * full.carriers.conj())[:, both].abs()
    assert float(turn.median()) < 0.05
    ratio = (dim.carriers.abs() / full.carriers.abs())[:, both]
    assert float(ratio.median()) == pytest.approx(gain, rel=0.05)


def test_misfit_is_small_on_smooth_fringes_and_large_at_an_edge() -> None:
    step = np.zeros((240, 320))
    step[:, 160:] = 60.4  # another depth, and far darker
    gain = np.where(step > 0, 0.12, 0.8)
    phase = WindowedFourierTransform().extract(composite_capture(plane_columns() + step, gain))["left"]
    assert phase.misfit is not None
    misfit = phase.misfit.numpy()[40:-40]
    smooth = np.concatenate([misfit[:, 40:120], misfit[:, 200:280]], axis=1)
    edge = misfit[:, 161:165]
    assert np.median(smooth) < 0.15
    assert np.median(edge) > 5 * np.median(smooth)


def test_reasons_of_pixels_without_a_phase() -> None:
    column, gain = plane_columns(), np.full((240, 320), 0.6)
    gain[:, 200:] = 0.0  # nothing there
    gain[:100, :60] = 1.6  # overexposed
    phase = WindowedFourierTransform().extract(composite_capture(column, gain))["left"]
    mask = phase.mask.numpy()
    assert (mask[140:220, 40:160] == Reason.VALID).mean() > 0.99
    assert np.isin(mask[:, 240:], (Reason.UNLIT, Reason.LOW_MODULATION)).mean() > 0.99
    image = composite_capture(column, gain).stack("left", "composite")[0]
    assert (mask[image >= 1.0] == Reason.SATURATED).all()
    assert (image >= 1.0).sum() > 500
