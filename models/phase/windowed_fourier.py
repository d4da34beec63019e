"""Windowed Fourier filtering on the decimated grid (paper, eq:window fourier transform .. eq:phase).

One band is the sum over its frequencies of threshold(f * g) * g with a Gaussian window g. Every f * g is narrow-band,
so it needs no more samples than its Gaussian has spectrum: crop the image's spectrum about the frequency, transform
the small crop back, threshold, transform forth, and add it into the spectrum where it came from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

Range = tuple[float, float]
_CUT = 3.3
"""Half-width of a crop in standard deviations of the window's spectrum; beyond it a window passes less than 0.5 %."""


@dataclass(frozen=True)
class Band:
    """Carrier frequencies to pass, rad/px: zeta along x (positive), eta along y."""

    zeta: Range
    eta: Range


@dataclass(frozen=True)
class Threshold:
    """When a windowed Fourier coefficient counts.

    noise: multiple of the coefficient's noise, estimated from the image's highest frequencies.
    relative: share of the largest coefficient at the same place; suppresses leakage of weak frequencies.
    """

    noise: float = 3.0
    relative: float = 0.0


class Spectrum:
    """Fourier transforms of images, padded by reflection so that borders do not wrap.

    images: float32 (V, H, W). values: complex64 (V, Hp, Wp). noise: float32 (V,), standard deviation of the white noise
    in the images, from the corner of the spectrum where no fringe or texture lies.
    """

    def __init__(self, images: torch.Tensor, margin: int) -> None:
        self.shape = (images.shape[-2], images.shape[-1])
        height, width = (fast_length(n + 2 * margin) for n in self.shape)
        self.offset = ((height - self.shape[0]) // 2, (width - self.shape[1]) // 2)
        top, left = self.offset
        pads = (left, width - self.shape[1] - left, top, height - self.shape[0] - top)
        padded = torch.nn.functional.pad(images[:, None], pads, mode="reflect")[:, 0]
        self.values = torch.fft.fft2(padded)
        quarter = self.values[:, 3 * height // 8 : 5 * height // 8, 3 * width // 8 : 5 * width // 8]
        power = torch.median((quarter.real**2 + quarter.imag**2).flatten(1), dim=1).values / math.log(2)
        self.noise = (power / (height * width)).sqrt()

    def crop_back(self, padded: torch.Tensor) -> torch.Tensor:
        """The part of a padded array (..., Hp, Wp) that belongs to the image, (..., H, W)."""
        top, left = self.offset
        return padded[..., top : top + self.shape[0], left : left + self.shape[1]]


def fast_length(minimum: int) -> int:
    """Smallest even length >= minimum with no prime factor over 5."""
    length = minimum + minimum % 2
    while True:
        rest = length
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return length
        length += 2


def low_pass(images: torch.Tensor, sigma: float, margin: int) -> torch.Tensor:
    """Gaussian mean of images (V, H, W) with standard deviation ``sigma`` px; borders are reflected."""
    spectrum = Spectrum(images, margin)
    height, width = spectrum.values.shape[-2:]
    y = torch.fft.fftfreq(height, device=images.device)[:, None] * (2 * math.pi * sigma)
    x = torch.fft.fftfreq(width, device=images.device) * (2 * math.pi * sigma)
    return spectrum.crop_back(torch.fft.ifft2(spectrum.values * torch.exp(-0.5 * (x**2 + y**2))).real)


class WindowedFourierFilter:
    """Windowed Fourier filter of one band for one padded size; built once, applied to many spectra.

    sigma: standard deviation (px) of the Gaussian window along x and y. Frequencies of the band are spaced by 1/sigma
    (the window's own resolution) and rounded to bins of the transform.
    """

    def __init__(self, padded: tuple[int, int], band: Band, sigma: float | tuple[float, float]) -> None:
        self.padded = padded
        self.band = band
        sigma_x, sigma_y = sigma if isinstance(sigma, tuple) else (sigma, sigma)
        self._columns = _Axis(padded[1], band.zeta, sigma_x)
        self._rows = _Axis(padded[0], band.eta, sigma_y)
        self.window = torch.outer(self._rows.window, self._columns.window)
        self.coefficient_noise = math.sqrt(self._rows.energy * self._columns.energy)
        self._gain = 2.0 / (self._rows.response * self._columns.response)

    @property
    def frequencies(self) -> int:
        """Number of windowed Fourier frequencies in the band."""
        return len(self._rows.bins) * len(self._columns.bins)

    def coefficients(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Windowed Fourier coefficients on the decimated grid, complex64 (V, rows, columns, h, w)."""
        window = self.window.to(spectrum.device)
        crops = spectrum[:, self._rows.indices[:, None, :, None], self._columns.indices[None, :, None, :]]
        scale = window.numel() / (self.padded[0] * self.padded[1])
        coefficients: torch.Tensor = torch.fft.ifft2(crops * (window * scale))
        return coefficients

    def synthesise(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Complex field of the band on the padded grid, complex64 (V, Hp, Wp); inverse of ``coefficients``."""
        window = self.window.to(coefficients.device)
        scale = self.padded[0] * self.padded[1] / window.numel()
        crops = torch.fft.fft2(coefficients) * (window * (scale * self._gain))
        rows, columns = self._rows, self._columns
        band = torch.zeros(len(crops), rows.extent, columns.extent, dtype=crops.dtype, device=crops.device)
        for i, y in enumerate(rows.starts):
            for j, x in enumerate(columns.starts):
                band[:, y : y + len(rows.window), x : x + len(columns.window)] += crops[:, i, j]
        tall = band.new_zeros(len(crops), self.padded[0], columns.extent)
        tall.index_add_(1, rows.covered.to(band.device), band)
        full = band.new_zeros(len(crops), *self.padded)
        full.index_add_(2, columns.covered.to(band.device), tall)
        field: torch.Tensor = torch.fft.ifft2(full)
        return field

    def __call__(self, spectrum: Spectrum, threshold: Threshold) -> torch.Tensor:
        """Filtered complex field (V, H, W): angle is the wrapped phase, absolute value the carrier's amplitude."""
        coefficients = self.coefficients(spectrum.values)
        magnitude = coefficients.abs()
        limit = (threshold.noise * self.coefficient_noise) * spectrum.noise[:, None, None, None, None]
        if threshold.relative > 0:
            limit = torch.maximum(limit, threshold.relative * magnitude.amax(dim=(1, 2), keepdim=True))
        kept = torch.where(magnitude >= limit, coefficients, 0)
        return spectrum.crop_back(self.synthesise(kept))


class _Axis:
    """Frequencies, crops and window of one axis of the transform."""

    def __init__(self, length: int, limits: Range, sigma: float) -> None:
        bin_width = 2 * math.pi / length
        first, last = (limit / bin_width for limit in limits)
        count = max(1, math.ceil((last - first) * bin_width * sigma - 1e-9) + 1)
        positions = (
            [0.5 * (first + last)] if count == 1 else [first + (last - first) * i / (count - 1) for i in range(count)]
        )
        self.bins = sorted({round(p) for p in positions})
        half = math.ceil(_CUT / sigma / bin_width)
        crop = min(fast_length(2 * half + 1), length)
        offsets = torch.arange(crop) - crop // 2
        self.window = torch.exp(-0.5 * (offsets * bin_width * sigma) ** 2)
        self.indices = torch.stack([(offsets + b) % length for b in self.bins])
        self.starts = [b - self.bins[0] for b in self.bins]
        self.extent = self.starts[-1] + crop
        self.covered = (torch.arange(self.extent) + self.bins[0] - crop // 2) % length
        self.energy = float((self.window**2).sum()) / length
        distance = (torch.arange(self.extent) - crop // 2)[:, None] - torch.tensor(self.starts)
        # Scaling by the peak of the summed windows, not flattening the sum, keeps neighbouring bands apart.
        self.response = float(torch.exp(-((distance * bin_width * sigma) ** 2)).sum(dim=1).max())
