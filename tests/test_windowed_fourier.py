"""The decimated windowed Fourier filter: amplitude, phase, selectivity, and agreement with the plain one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from models.phase.windowed_fourier import Band, Spectrum, Threshold, WindowedFourierFilter, fast_length, low_pass

HEIGHT, WIDTH = 120, 160
BAND = Band((0.6, 0.95), (-0.3, 0.3))


def fringes(zeta: float, eta: float = 0.0, amplitude: float = 0.2, offset: float = 0.4) -> torch.Tensor:
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    return amplitude * torch.cos(zeta * x + eta * y + offset)


def filtered(
    image: torch.Tensor, band: Band = BAND, sigma: float = 6.0, threshold: Threshold | None = None, margin: int = 24
) -> torch.Tensor:
    spectrum = Spectrum(image[None], margin)
    padded = (spectrum.values.shape[-2], spectrum.values.shape[-1])
    return WindowedFourierFilter(padded, band, sigma)(spectrum, threshold or Threshold(3.0, 0.0))[0]


def inner(field: torch.Tensor, border: int = 24) -> torch.Tensor:
    return field[border:-border, border:-border]


@settings(max_examples=12)
@given(
    zeta=st.floats(0.62, 0.93),
    eta=st.floats(-0.28, 0.28),
    amplitude=st.floats(0.01, 0.4),
    offset=st.floats(-3.0, 3.0),
)
def test_a_cosine_comes_back_with_its_amplitude_and_phase(
    zeta: float, eta: float, amplitude: float, offset: float
) -> None:
    field = filtered(fringes(zeta, eta, amplitude, offset))
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    truth = torch.polar(torch.ones(HEIGHT, WIDTH), zeta * x + eta * y + offset)
    assert float(inner(torch.angle(field * truth.conj())).abs().max()) < 0.03
    # The summed windows are not flat: less than their peak passes near the ends of the band.
    assert 0.6 * amplitude < float(inner(field).abs().mean()) < 1.1 * amplitude


def test_frequencies_outside_the_band_are_rejected() -> None:
    inside = float(inner(filtered(fringes(0.75))).abs().mean())
    for zeta, eta in ((0.15, 0.0), (1.6, 0.0), (0.75, 1.1), (-0.75, 0.9)):
        assert float(inner(filtered(fringes(zeta, eta))).abs().mean()) < 0.01 * inside


def test_a_constant_image_gives_nothing() -> None:
    assert float(filtered(torch.full((HEIGHT, WIDTH), 0.5)).abs().max()) < 1e-3


@pytest.mark.parametrize("gain", [0.01, 37.0])
def test_the_filter_has_no_scale_of_its_own(gain: float) -> None:
    image = 0.4 + fringes(0.8, 0.1) + 0.01 * torch.from_numpy(np.random.default_rng(0).normal(size=(HEIGHT, WIDTH)))
    once, scaled = (filtered((g * image).float(), threshold=Threshold(3.0, 0.3)) for g in (1.0, gain))
    assert float((scaled / gain - once).abs().max()) < 1e-3 * float(once.abs().max())


def test_thresholding_removes_noise() -> None:
    noise = 0.05 * torch.from_numpy(np.random.default_rng(1).normal(size=(HEIGHT, WIDTH))).float()
    kept, all_of_it = filtered(noise, threshold=Threshold(3.5)), filtered(noise, threshold=Threshold(0.0))
    assert float(kept.abs().square().mean()) < 0.05 * float(all_of_it.abs().square().mean())


def test_noise_is_estimated_from_the_image() -> None:
    noise = torch.from_numpy(np.random.default_rng(2).normal(0, 0.03, (3, 256, 320))).float()
    images = noise + 0.5 + 0.2 * torch.cos(0.8 * torch.arange(320))
    assert Spectrum(images, 20).noise.numpy() == pytest.approx(0.03, rel=0.05)


def plain_filter(image: torch.Tensor, band: Band, sigma: float, threshold: Threshold, margin: int) -> torch.Tensor:
    """Windowed Fourier filtering by definition: one full-size FFT pair for each frequency.

    The frequencies are the transform's bins nearest to a spacing of 1 / sigma.
    """
    spectrum = Spectrum(image[None], margin)
    values = spectrum.values[0]
    height, width = values.shape
    y = 2 * math.pi * torch.fft.fftfreq(height)[:, None]
    x = 2 * math.pi * torch.fft.fftfreq(width)

    def spaced(limits: tuple[float, float], length: int) -> np.ndarray:
        wanted = np.linspace(*limits, math.ceil((limits[1] - limits[0]) * sigma) + 1)
        return np.unique(np.rint(wanted * length / (2 * np.pi))) * (2 * np.pi / length)

    windows = [
        torch.exp(-0.5 * sigma**2 * ((x - zeta) ** 2 + (y - eta) ** 2))
        for zeta in spaced(band.zeta, width)
        for eta in spaced(band.eta, height)
    ]
    coefficients = [torch.fft.ifft2(values * window) for window in windows]
    largest = torch.stack([c.abs() for c in coefficients]).amax(dim=0)
    total = torch.zeros_like(values)
    for window, coefficient in zip(windows, coefficients, strict=True):
        noise = float(spectrum.noise[0]) * float((window**2).sum() / window.numel()) ** 0.5
        limit = torch.maximum(threshold.relative * largest, torch.tensor(threshold.noise * noise))
        total += torch.fft.fft2(torch.where(coefficient.abs() >= limit, coefficient, 0)) * window
    return spectrum.crop_back(torch.fft.ifft2(total))


@pytest.mark.parametrize("sigma", [6.0, 10.0])
@pytest.mark.parametrize("threshold", [Threshold(0.0), Threshold(3.0, 0.3)], ids=["linear", "thresholded"])
def test_agrees_with_the_plain_filter(sigma: float, threshold: Threshold) -> None:
    """A bump with an edge: fringes that bend, and a part without any."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    bump = 6 * torch.exp(-((x - 95) ** 2 + (y - 65) ** 2) / 1500.0)
    lit = ((x > 30) & (y > 20)).float()
    noise = torch.from_numpy(np.random.default_rng(3).normal(0, 0.01, (HEIGHT, WIDTH))).float()
    image = lit * (0.4 + 0.2 * torch.cos(0.78 * x + bump)) + noise
    fast = filtered(image, sigma=sigma, threshold=threshold)
    plain = plain_filter(image, BAND, sigma, threshold, 24)
    signal = (fast.abs() > 0.05) & (plain.abs() > 0.05 * plain.abs().max() / fast.abs().max())
    assert signal.float().mean() > 0.5
    difference = torch.angle(fast * plain.conj())[signal]
    assert float(difference.square().mean().sqrt()) <= 0.02


def test_low_pass_keeps_the_mean_and_smooths() -> None:
    image = 0.5 + fringes(0.8)
    smooth = low_pass(image[None], 10.0, 24)[0]
    assert float((inner(smooth) - 0.5).abs().max()) < 2e-3
    ramp = torch.linspace(0, 1, WIDTH).repeat(HEIGHT, 1)
    assert float((inner(low_pass(ramp[None], 3.0, 24)[0]) - inner(ramp)).abs().max()) < 2e-3


@given(st.integers(1, 4000))
def test_transform_lengths_are_even_and_smooth(minimum: int) -> None:
    length = fast_length(minimum)
    assert minimum <= length <= 1.35 * minimum + 2
    assert length % 2 == 0
    rest = length
    for factor in (2, 3, 5):
        while rest % factor == 0:
            rest //= factor
    assert rest == 1
