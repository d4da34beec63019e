"""N-step phase shifting recovers phase and modulation exactly, whatever the plan's steps, sign and offset."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from ideal_camera import fringe_steps, shown

from models.errors import CaptureError
from models.phase.phase_shift import demodulate


@given(
    steps=st.integers(3, 24),
    period=st.floats(4.0, 40.0),
    offset=st.floats(-7.0, 7.0),
    sign=st.sampled_from([1, -1]),
    albedo=st.floats(0.1, 1.0),
)
def test_phase_and_modulation_are_exact(steps: int, period: float, offset: float, sign: int, albedo: float) -> None:
    column = np.linspace(0, 60, 241)[None]
    patterns = fringe_steps(steps, period, sign, offset)
    field = demodulate(shown(patterns, column, albedo, ambient=0.05), patterns).numpy()
    truth = np.exp(2j * np.pi * column / period)
    assert np.abs(np.angle(field * truth.conj())).max() < 1e-4
    assert np.abs(np.abs(field) - albedo / 2).max() < 1e-5


def test_exposures_in_any_order() -> None:
    patterns = fringe_steps(9, 9.0)
    shuffled = [patterns[k] for k in (3, 0, 8, 1, 7, 2, 6, 4, 5)]
    column = np.linspace(0, 30, 91)[None]
    field = demodulate(shown(shuffled, column), shuffled).numpy()
    assert np.abs(np.angle(field * np.exp(-2j * np.pi * column / 9))).max() < 1e-5


@pytest.mark.parametrize("steps", [3, 9])
def test_noise_falls_with_the_steps_as_theory_says(steps: int) -> None:
    sigma, modulation = 0.01, 0.25
    patterns = fringe_steps(steps, 9.0)
    column = np.linspace(0, 200, 20_000)[None]
    noise = np.random.default_rng(4).normal(0, sigma, (steps, 1, column.size)).astype(np.float32)
    field = demodulate(shown(patterns, column, 2 * modulation) + torch.from_numpy(noise), patterns).numpy()
    error = np.angle(field * np.exp(-2j * np.pi * column / 9)).std()
    assert error == pytest.approx(math.sqrt(2 / steps) * sigma / modulation, rel=0.05)


@pytest.mark.parametrize("lost", [0, 4, 8])
def test_an_incomplete_set_is_refused(lost: int) -> None:
    patterns = [p for p in fringe_steps(9, 9.0) if p.step != lost]
    with pytest.raises(CaptureError, match=r"high.*8 of 9"):
        demodulate(torch.zeros(8, 2, 2), patterns)
