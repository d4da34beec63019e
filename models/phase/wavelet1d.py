"""The ridge of a complex Morlet transform along the image's rows (paper, baseline Wavelet-1D)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.phase.atoms import AtomBank, Columns, band_limits, geometric_steps
from models.phase.ridge import ridge
from models.phase.transform_method import TransformMethod, TransformSettings
from models.phase.transform_settings import chosen_settings
from models.phase.windowed_fourier import Band, Spectrum

_REACH = 3.3
"""Standard deviations of an atom's spectrum that are kept."""


@dataclass(frozen=True, kw_only=True)
class Wavelet1dSettings(TransformSettings):
    """Settings of the method ``wavelet1d``, beside those of the mask.

    window: standard deviation of an atom in its own wavelengths. scales: atoms from one end of a carrier's band to the
    other, at equal ratios. A row averages less noise than a window does, hence the larger minimum_modulation.
    """

    window: float
    scales: int
    minimum_modulation: float = 0.0025


class Wavelet1d(TransformMethod[Wavelet1dSettings, AtomBank]):
    """Method ``wavelet1d``."""

    name = "wavelet1d"

    def _chosen(self) -> Wavelet1dSettings:
        return Wavelet1dSettings(**chosen_settings(self.name))

    @property
    def _margin(self) -> float:
        return 3 * self.settings.window

    def _bank(self, padded: tuple[int, int], margin: int, bands: tuple[Band, ...], device: torch.device) -> AtomBank:
        return _atoms(padded, margin, bands, self.settings, device)

    def _carrier(self, bank: AtomBank, spectrum: Spectrum, size: tuple[int, int]) -> torch.Tensor:
        answers = bank.coefficients(spectrum)[:, :, None]
        return bank.unshift(ridge(answers), spectrum.offset[1])


@lru_cache(maxsize=4)
def _atoms(
    padded: tuple[int, int],
    margin: int,
    bands: tuple[Band, ...],
    settings: Wavelet1dSettings,
    device: torch.device,
) -> AtomBank:
    limits = band_limits(bands)
    centres = geometric_steps(limits[..., 0], limits[..., 1], settings.scales)[..., None]
    spread = 1 / (2 * math.pi * settings.window)
    columns = Columns(
        padded[1],
        (float(limits[..., 0].min()) * (1 - _REACH * spread), float(limits[..., 1].max()) * (1 + _REACH * spread)),
    )
    windows = torch.exp(-0.5 * ((columns.zeta / centres - 1) / spread) ** 2)
    return AtomBank(windows[..., None, :].to(device), columns, margin)
