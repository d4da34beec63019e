"""The single-shot method without learning: windowed Fourier filtering of both carriers, with their leakage cancelled.

A window small enough to follow an object is wide in frequency: at sigma = 6 px the high band hears the low carrier.
Each carrier is therefore filtered from the image less the other carrier and less the background, and again with
the better estimates; leakage falls by the window's rejection each time round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.geometry.rig import Rig
from models.phase.bands import FringeField, carrier_bands
from models.phase.single_exposure import MaskSettings, SingleExposure
from models.phase.windowed_fourier import Band, Spectrum, Threshold, WindowedFourierFilter, low_pass


@dataclass(frozen=True, kw_only=True)
class WftSettings(MaskSettings):
    """Settings of the method ``wft``, beside those of the mask.

    window: standard deviation of the Gaussian window in fringes of the carrier (px = window * period in the image).
    rounds: filterings of each carrier; 1 is the plain filter. noise, first_relative, relative: see ``Threshold``; the
    first round is more selective because it hears the other carrier.
    """

    window: float = 0.4
    rounds: int = 4
    noise: float = 2.0
    first_relative: float = 0.5
    relative: float = 0.2


class WindowedFourierTransform(SingleExposure):
    """Method ``wft``; see ``SingleExposure`` for rig and depth_range."""

    name = "wft"

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        settings: WftSettings | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = settings or WftSettings()
        super().__init__(rig, depth_range, self.settings, device)

    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        views = [self._view(image[None], field, periods) for image, field in zip(images, fields, strict=True)]
        return torch.stack([carriers for carriers, _ in views]), torch.stack([texture for _, texture in views])

    def _view(
        self, image: torch.Tensor, field: FringeField, periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        bands = carrier_bands(field, periods)
        sigmas = [self.settings.window * 2 * torch.pi * period / field.zeta[1] for period in periods]
        margin = int(min(2 * max(sigmas), min(image.shape[-2:]) / 4))
        return separate(image, bands, sigmas, margin, self.settings)


@lru_cache(maxsize=16)
def _filter(padded: tuple[int, int], band: Band, sigma: float) -> WindowedFourierFilter:
    return WindowedFourierFilter(padded, band, sigma)


def separate(
    image: torch.Tensor, bands: list[Band], sigmas: list[float], margin: int, settings: WftSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """Carriers complex64 (C, H, W) and background float32 (H, W) of one image (1, H, W), share of full scale."""
    carriers = [torch.zeros_like(image, dtype=torch.complex64) for _ in bands]
    for turn in range(settings.rounds):
        rest = image - sum(c.real for c in carriers)
        background = low_pass(rest, 0.7 * max(sigmas), margin)
        relative = settings.first_relative if turn == 0 and settings.rounds > 1 else settings.relative
        for index, (band, sigma) in enumerate(zip(bands, sigmas, strict=True)):
            others = sum((c.real for k, c in enumerate(carriers) if k != index), background)
            carriers[index] = _apply(image - others, band, sigma, margin, Threshold(settings.noise, relative))
    return torch.cat(carriers), background[0]


def _apply(image: torch.Tensor, band: Band, sigma: float, margin: int, threshold: Threshold) -> torch.Tensor:
    spectrum = Spectrum(image, margin)
    padded = (spectrum.values.shape[-2], spectrum.values.shape[-1])
    return _filter(padded, band, sigma)(spectrum, threshold)
