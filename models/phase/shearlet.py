"""Band-limited shearlets of the horizontal cone, thresholded and summed back (paper, baseline Shearlet).

The fringes' frequencies lie about the zeta axis, so the vertical cone is never needed. A shearlet's spectrum is the
product of a Meyer window over log zeta, its scale, and one over eta / zeta, its shear. The squares of both sum to 1,
so that a field whose coefficients all count comes back as it was. Dyadic scales would hold both carriers at once:
an octave is cut into voices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.phase.atoms import AtomBank, Columns, band_limits
from models.phase.transform_method import TransformMethod, TransformSettings
from models.phase.transform_settings import chosen_settings
from models.phase.windowed_fourier import Band, Spectrum


@dataclass(frozen=True, kw_only=True)
class ShearletSettings(TransformSettings):
    """Settings of the method ``shearlet``, beside those of the mask.

    voices: scales an octave. shear: step of eta / zeta between shears at the middle of a carrier's band; it goes with
    zeta to the power of -1/2, the parabolic scaling of shearlets. As many scales and shears are taken as fill the band,
    to half their power at its ends. noise, relative: which coefficients count, see
    ``Threshold``.
    """

    voices: float
    shear: float
    noise: float
    relative: float


class Shearlet(TransformMethod[ShearletSettings, tuple[AtomBank, torch.Tensor]]):
    """Method ``shearlet``."""

    name = "shearlet"

    def _chosen(self) -> ShearletSettings:
        return ShearletSettings(**chosen_settings(self.name))

    @property
    def _margin(self) -> float:
        return 3.0

    def _bank(
        self, padded: tuple[int, int], margin: int, bands: tuple[Band, ...], device: torch.device
    ) -> tuple[AtomBank, torch.Tensor]:
        return _atoms(padded, margin, bands, self.settings, device)

    def _carrier(self, bank: tuple[AtomBank, torch.Tensor], spectrum: Spectrum, size: tuple[int, int]) -> torch.Tensor:
        atoms, noise = bank
        coefficients = atoms.coefficients_padded(spectrum)
        modulus = coefficients.abs()
        level = self.settings.noise * spectrum.noise[:, None] * noise
        largest = modulus.amax(dim=1, keepdim=True)
        least = torch.maximum(level[..., None, None], self.settings.relative * largest)
        return spectrum.crop_back(atoms.synthesise(torch.where(modulus >= least, coefficients, 0)))


@lru_cache(maxsize=4)
def _atoms(
    padded: tuple[int, int],
    margin: int,
    bands: tuple[Band, ...],
    settings: ShearletSettings,
    device: torch.device,
) -> tuple[AtomBank, torch.Tensor]:
    """The bank, and the standard deviation of its coefficients for unit white noise, (V, N)."""
    limits = band_limits(bands)
    octaves = torch.log2(limits[:, :2])
    middle = octaves.mean(dim=1, keepdim=True)
    scales = max(1, round(float((octaves[:, 1] - octaves[:, 0]).max()) * settings.voices))
    centres = middle + (torch.arange(scales) - (scales - 1) / 2) / settings.voices
    step = settings.shear * 2.0 ** (0.5 * (middle - centres))
    slopes = limits[:, 2:] / 2.0**middle
    shears = max(1, round(float(((slopes[:, 1:] - slopes[:, :1]) / step).max())))
    reach = 1 / settings.voices
    columns = Columns(padded[1], (2.0 ** (float(centres.min()) - reach), 2.0 ** (float(centres.max()) + reach)))
    eta = torch.fft.fftfreq(padded[0])[:, None] * (2 * math.pi)
    scale = _meyer((torch.log2(columns.zeta) - centres[..., None]) * settings.voices)
    tilts = slopes.mean(dim=1)[:, None, None] / step[..., None] + torch.arange(shears) - (shears - 1) / 2
    shear = _meyer((eta / columns.zeta) / step[..., None, None, None] - tilts[..., None, None])
    windows = (scale[:, :, None, None, :] * shear).flatten(1, 2)
    energy = (4 * windows**2).sum(dim=(-2, -1)) / (padded[0] * padded[1])
    return AtomBank(windows.to(device), columns, margin), energy.sqrt().to(device)


def _meyer(distance: torch.Tensor) -> torch.Tensor:
    """Meyer's window: 1 at 0, 0 from a distance of 1 on, with squares that sum to 1 over windows one apart."""
    t = distance.abs().clamp(max=1)
    rise = t**4 * (35 - 84 * t + 70 * t**2 - 20 * t**3)
    return torch.cos(0.5 * math.pi * rise)
