"""Banks of analytic atoms given by their spectra, applied to all views at once.

The spectra of a bank fill only some of the transform's columns. Columns outside are neither stored nor transformed
along y; and shifting the rest to column 0 only turns all coefficients by a common factor, which is undone at the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch

from models.phase.windowed_fourier import Band, Spectrum, fast_length


def padded_size(size: tuple[int, int], margin: int) -> tuple[int, int]:
    """Size (height, width) of ``Spectrum`` for images of this size."""
    return fast_length(size[0] + 2 * margin), fast_length(size[1] + 2 * margin)


def band_limits(bands: Iterable[Band]) -> torch.Tensor:
    """Of one band a view: (low, high) of zeta and of eta, rad/px, float32 (V, 4)."""
    return torch.tensor([(*band.zeta, *band.eta) for band in bands], dtype=torch.float32)


def geometric_steps(low: torch.Tensor, high: torch.Tensor, count: int) -> torch.Tensor:
    """``count`` values with equal ratios from low to high (...), along a new last axis."""
    share = torch.linspace(0, 1, count)
    return low[..., None] * (high / low)[..., None] ** share


class Columns:
    """Columns of a transform of width ``width`` between two frequencies ``zeta``, rad/px, as one run."""

    def __init__(self, width: int, zeta: tuple[float, float]) -> None:
        bin_width = 2 * math.pi / width
        self.width = width
        self.first = max(1, math.floor(zeta[0] / bin_width))
        self.last = min(width // 2, max(self.first, math.ceil(zeta[1] / bin_width)))
        self.zeta = torch.arange(self.first, self.last + 1) * bin_width

    def of(self, spectra: torch.Tensor) -> torch.Tensor:
        """These columns of spectra (..., width)."""
        return spectra[..., self.first : self.last + 1]

    def turn(self, device: torch.device) -> torch.Tensor:
        """Factors complex64 (width,) that undo the shift of the first column to 0."""
        angle = torch.arange(self.width, dtype=torch.float64) * (2 * math.pi * self.first / self.width)
        return torch.polar(torch.ones_like(angle), angle).to(device, torch.complex64)


class AtomBank:
    """Spectra of atoms for every view, and the transform to coefficients and back.

    windows: float32 (V, N, h, w) on the columns ``columns``; h is the height of the padded image, or 1 for atoms
    that are a single row. margin: px by which images are padded, by reflection.
    """

    def __init__(self, windows: torch.Tensor, columns: Columns, margin: int) -> None:
        self.windows = windows
        self.columns = columns
        self.margin = margin

    def coefficients(self, spectrum: Spectrum) -> torch.Tensor:
        """Shifted coefficients complex64 (V, N, H, W); a wave of amplitude a at an atom's peak answers with a."""
        top, left = spectrum.offset
        height, width = spectrum.shape
        down = torch.fft.ifft(self._weighted(spectrum), dim=-2)[..., top : top + height, :]
        answers: torch.Tensor = torch.fft.ifft(down, n=self.columns.width)
        return answers[..., left : left + width]

    def coefficients_padded(self, spectrum: Spectrum) -> torch.Tensor:
        """The same on the padded grid, (V, N, Hp, Wp)."""
        answers: torch.Tensor = torch.fft.ifft(torch.fft.ifft(self._weighted(spectrum), dim=-2), n=self.columns.width)
        return answers

    def unshift(self, field: torch.Tensor, offset: int) -> torch.Tensor:
        """A field (..., W) of shifted coefficients, whose first column is column ``offset`` of the padded grid."""
        return field * self.columns.turn(field.device)[offset : offset + field.shape[-1]]

    def synthesise(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Field (V, Hp, Wp), unshifted, as the sum of the atoms; the inverse for a bank whose squares sum to 1."""
        across = torch.fft.fft(coefficients)[..., : self.windows.shape[-1]]
        spectra = (torch.fft.fft(across, dim=-2) * self.windows).sum(dim=1)
        field = torch.fft.ifft(torch.fft.ifft(spectra, dim=-2), n=self.columns.width)
        return self.unshift(field, 0)

    def _weighted(self, spectrum: Spectrum) -> torch.Tensor:
        return self.columns.of(spectrum.values)[:, None] * (2 * self.windows)
