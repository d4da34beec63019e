"""Electrons to grey levels."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.simulator.sensor import REFERENCE_EXPOSURE_US, Sensor


def flat(level: float) -> np.ndarray:
    return np.full((300, 400), level, np.float32)


@pytest.mark.parametrize("bit_depth", [8, 12])
@pytest.mark.parametrize("level", [0.05, 0.1, 0.4, 0.8])
def test_variance_is_shot_noise_plus_read_noise_plus_quantisation(bit_depth, level):
    sensor = Sensor(bit_depth=bit_depth)
    image = sensor.digitise(flat(level), np.random.default_rng(1)).astype(np.float64)
    levels_per_electron = sensor.white_level / sensor.full_well
    electrons = level * sensor.full_well
    assert image.mean() == pytest.approx(level * sensor.white_level + sensor.white_level / 255, rel=2e-3)
    expected = (electrons + 64) * levels_per_electron**2 + 1 / 12
    assert image.var() == pytest.approx(expected, rel=0.03)  # the sampling error of a variance of 120,000 is 0.4 %


def test_twelve_bits_are_stored_in_sixteen():
    sensor = Sensor(bit_depth=12)
    image = sensor.digitise(flat(2.0), np.random.default_rng(0))
    assert image.dtype == np.uint16
    assert sensor.white_level == 4095 == image.min() == image.max()
    assert Sensor().digitise(flat(2.0), np.random.default_rng(0)).dtype == np.uint8


def test_without_light_it_reads_the_black_level():
    image = Sensor(black_level=3.0).digitise(flat(0.0), np.random.default_rng(0))
    assert image.mean() == pytest.approx(3.0, abs=0.01)
    clipped = Sensor(black_level=0.0).digitise(flat(0.0), np.random.default_rng(0))
    assert clipped.max() <= 1  # eight electrons are a fifth of a level


def test_exposure_and_gain_scale_the_reading():
    quiet = {"noiseless": True, "black_level": 0.0, "bit_depth": 12}
    read = lambda **settings: int(Sensor(**quiet, **settings).digitise(flat(0.2), np.random.default_rng(0))[0, 0])  # noqa: E731
    assert read() == pytest.approx(0.2 * 4095, abs=0.51)
    assert read(exposure_us=2 * REFERENCE_EXPOSURE_US) == pytest.approx(0.4 * 4095, abs=0.51)
    assert read(gain_db=6.0206) == pytest.approx(0.4 * 4095, abs=0.6)


def test_gain_amplifies_noise_with_the_signal():
    """At the same reading twice the gain has half the electrons, so its noise is larger by about the root of two."""
    bright = Sensor(bit_depth=12).digitise(flat(0.6), np.random.default_rng(2))
    amplified = Sensor(bit_depth=12, gain_db=6.0206).digitise(flat(0.3), np.random.default_rng(2))
    assert amplified.mean() == pytest.approx(bright.mean(), rel=2e-3)
    assert amplified.std() / bright.std() == pytest.approx(np.sqrt(2), rel=0.03)


def test_full_well_limits_a_long_exposure_at_low_gain():
    sensor = Sensor(gain_db=-6.0206, noiseless=True, black_level=0.0)
    image = sensor.digitise(flat(5.0), np.random.default_rng(0))
    assert image.max() == pytest.approx(127.5, abs=1)
