"""The ridge of a complex Morlet transform along the image's rows (paper, baseline Wavelet-1D)."""

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
class Wavelet1dSettings(MaskSettings):
    """Settings of the method ``wavelet1d``, beside those of the mask.

    window: standard deviation of an atom in its own wavelengths. scales: atoms from one end of a carrier's band to the
    other, at equal ratios. rounds: transforms of each carrier, see ``cancel_leakage``. background: standard deviation
    of the texture's low pass in fringes of the coarsest carrier. A row averages less noise than a window
    does, hence the larger minimum_modulation.
    """

    window: float
    scales: int
    rounds: int
    background: float
    minimum_modulation: float = 0.0025


class Wavelet1d(SingleExposure):
    """Method ``wavelet1d``; see ``SingleExposure`` for rig and depth_range. Settings are by default the chosen ones."""

    name = "wavelet1d"

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        settings: Wavelet1dSettings | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = settings or Wavelet1dSettings(**chosen_settings(self.name))
        super().__init__(rig, depth_range, self.settings, device)

    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        settings = self.settings
        size = (images.shape[-2], images.shape[-1])
        bands = list(zip(*(carrier_bands(field, periods) for field in fields), strict=True))
        longest = max(fringe_px(field, max(periods)) for field in fields)
        margin = int(min(3 * settings.window * longest, min(size) / 4))
        banks = [_bank(padded_size(size, margin), margin, views, settings, images.device) for views in bands]

        def transform(index: int, parts: torch.Tensor) -> torch.Tensor:
            spectrum = Spectrum(parts, margin)
            answers = banks[index].coefficients(spectrum)[:, :, None]
            return banks[index].unshift(ridge(answers), spectrum.offset[1])

        return cancel_leakage(images, len(periods), transform, settings.rounds, settings.background * longest)


@lru_cache(maxsize=4)
def _bank(
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
