"""What the transform methods share: a bank of atoms a carrier, and rounds that cancel what it hears of the rest."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import torch

from models.geometry.rig import Rig
from models.phase.atoms import padded_size
from models.phase.bands import FringeField, carrier_bands
from models.phase.leakage import cancel_leakage
from models.phase.single_exposure import MaskSettings, SingleExposure, fringe_px
from models.phase.windowed_fourier import Band, Spectrum


@dataclass(frozen=True, kw_only=True)
class TransformSettings(MaskSettings):
    """rounds: transforms of each carrier, see ``cancel_leakage``. background: standard deviation of the texture's low
    pass in fringes of the coarsest carrier."""

    rounds: int
    background: float


S = TypeVar("S", bound=TransformSettings)
B = TypeVar("B")


class TransformMethod(SingleExposure, Generic[S, B]):
    """See ``SingleExposure`` for rig and depth_range. Settings are by default those that were chosen for the method."""

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        settings: S | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings: S = settings or self._chosen()
        super().__init__(rig, depth_range, self.settings, device)

    @abstractmethod
    def _chosen(self) -> S:
        """The stored settings."""

    @property
    @abstractmethod
    def _margin(self) -> float:
        """How far atoms reach over the image's border, in fringes of the coarsest carrier."""

    @abstractmethod
    def _bank(self, padded: tuple[int, int], margin: int, bands: tuple[Band, ...], device: torch.device) -> B:
        """Atoms of one carrier, bands by view, for images padded to (H, W); made once for each."""

    @abstractmethod
    def _carrier(self, bank: B, spectrum: Spectrum, size: tuple[int, int]) -> torch.Tensor:
        """Complex field (V, H, W) of a carrier in images of this size."""

    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        settings = self.settings
        size = (images.shape[-2], images.shape[-1])
        bands = zip(*(carrier_bands(field, periods) for field in fields), strict=True)
        longest = max(fringe_px(field, max(periods)) for field in fields)
        margin = int(min(self._margin * longest, min(size) / 4))
        banks = [self._bank(padded_size(size, margin), margin, views, images.device) for views in bands]

        def transform(index: int, parts: torch.Tensor) -> torch.Tensor:
            return self._carrier(banks[index], Spectrum(parts, margin), size)

        return cancel_leakage(images, len(periods), transform, settings.rounds, settings.background * longest)
