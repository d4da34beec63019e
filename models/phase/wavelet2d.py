"""The ridge of a bank of 2-D complex Morlet (Gabor) atoms over wavelength and orientation (paper, Wavelet-2D)."""

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
class Wavelet2dSettings(TransformSettings):
    """Settings of the method ``wavelet2d``, beside those of the mask.

    window: standard deviation of an atom across its fringes, in its own wavelengths. aspect: that along the fringes as
    a multiple of it. scales: wavelengths from one end of a carrier's band to the other, at equal ratios. orientations:
    directions of the fringes over the band.
    """

    window: float
    aspect: float
    scales: int
    orientations: int


class Wavelet2d(TransformMethod[Wavelet2dSettings, AtomBank]):
    """Method ``wavelet2d``."""

    name = "wavelet2d"

    def _chosen(self) -> Wavelet2dSettings:
        return Wavelet2dSettings(**chosen_settings(self.name))

    @property
    def _margin(self) -> float:
        return 3 * self.settings.window * max(1.0, self.settings.aspect)

    def _bank(self, padded: tuple[int, int], margin: int, bands: tuple[Band, ...], device: torch.device) -> AtomBank:
        return _atoms(padded, margin, bands, self.settings, device)

    def _carrier(self, bank: AtomBank, spectrum: Spectrum, size: tuple[int, int]) -> torch.Tensor:
        answers = bank.coefficients(spectrum)
        shape = (len(answers), self.settings.scales, self.settings.orientations, *size)
        return bank.unshift(ridge(answers.reshape(shape)), spectrum.offset[1])


@lru_cache(maxsize=4)
def _atoms(
    padded: tuple[int, int],
    margin: int,
    bands: tuple[Band, ...],
    settings: Wavelet2dSettings,
    device: torch.device,
) -> AtomBank:
    limits = band_limits(bands)
    centres = geometric_steps(limits[..., 0], limits[..., 1], settings.scales)
    middle = (limits[..., 0] * limits[..., 1]).sqrt()
    steepest = torch.atan2(limits[..., 2:], middle[..., None])
    share = torch.linspace(0, 1, settings.orientations) if settings.orientations > 1 else torch.tensor([0.5])
    angles = steepest[..., :1] + (steepest[..., 1:] - steepest[..., :1]) * share
    spread = 1 / (2 * math.pi * settings.window)
    wider = _REACH * spread * max(1.0, 1 / settings.aspect)
    least = float((limits[..., 0, None] * angles.cos()).min()) - wider * float(limits[..., 0].min())
    columns = Columns(padded[1], (least, float(limits[..., 1].max()) * (1 + wider)))
    zeta = columns.zeta
    eta = torch.fft.fftfreq(padded[0])[:, None] * (2 * math.pi)
    radius, angle = centres[:, :, None, None, None], angles[:, None, :, None, None]
    across = (zeta * angle.cos() + eta * angle.sin()) / radius - 1
    along = (eta * angle.cos() - zeta * angle.sin()) / radius * settings.aspect
    windows = torch.exp(-0.5 * (across**2 + along**2) / spread**2)
    return AtomBank(windows.flatten(1, 2).to(device), columns, margin)
