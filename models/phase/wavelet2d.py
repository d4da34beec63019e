"""The ridge of a bank of 2-D complex Morlet (Gabor) atoms over wavelength and orientation (paper, Wavelet-2D)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.geometry.rig import Rig
from models.phase.atoms import AtomBank, Columns, band_limits, geometric_steps, padded_size
from models.phase.bands import FringeField, carrier_bands
from models.phase.leakage import cancel_leakage
from models.phase.ridge import ridge
from models.phase.single_exposure import MaskSettings, SingleExposure, fringe_px
from models.phase.transform_settings import chosen_settings
from models.phase.windowed_fourier import Band, Spectrum

_REACH = 3.3
"""Standard deviations of an atom's spectrum that are kept."""


@dataclass(frozen=True, kw_only=True)
class Wavelet2dSettings(MaskSettings):
    """Settings of the method ``wavelet2d``, beside those of the mask.

    window: standard deviation of an atom across its fringes, in its own wavelengths. aspect: that along the fringes as
    a multiple of it. scales: wavelengths from one end of a carrier's band to the other, at equal ratios. orientations:
    directions of the fringes over the band. rounds, background: as in ``Wavelet1dSettings``.
    """

    window: float
    aspect: float
    scales: int
    orientations: int
    rounds: int
    background: float


class Wavelet2d(SingleExposure):
    """Method ``wavelet2d``; see ``SingleExposure`` for rig and depth_range. Settings are by default the chosen ones."""

    name = "wavelet2d"

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        settings: Wavelet2dSettings | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = settings or Wavelet2dSettings(**chosen_settings(self.name))
        super().__init__(rig, depth_range, self.settings, device)

    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        settings = self.settings
        size = (images.shape[-2], images.shape[-1])
        bands = list(zip(*(carrier_bands(field, periods) for field in fields), strict=True))
        longest = max(fringe_px(field, max(periods)) for field in fields)
        margin = int(min(3 * settings.window * max(1.0, settings.aspect) * longest, min(size) / 4))
        banks = [_bank(padded_size(size, margin), margin, views, settings, images.device) for views in bands]

        def transform(index: int, parts: torch.Tensor) -> torch.Tensor:
            spectrum = Spectrum(parts, margin)
            answers = banks[index].coefficients(spectrum)
            return banks[index].unshift(
                ridge(answers.reshape(len(answers), settings.scales, settings.orientations, *size)), spectrum.offset[1]
            )

        return cancel_leakage(images, len(periods), transform, settings.rounds, settings.background * longest)


@lru_cache(maxsize=4)
def _bank(
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
