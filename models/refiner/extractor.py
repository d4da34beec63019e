"""Method ``refiner``: windowed Fourier filtering, refined by the network, which doubts itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch

from models.geometry.rig import Rig
from models.phase.bands import FringeField
from models.phase.single_exposure import Estimate, MaskSettings, SingleExposure, misfit_of
from models.phase.wft import WindowedFourierTransform
from models.refiner.fields import RefinerInput
from models.refiner.network import Refiner
from models.refiner.shipped import find_weights
from models.refiner.weights import RECORD_NAME, TENSORS_NAME, WeightsRecord, load_weights


@dataclass(frozen=True, kw_only=True)
class RefinementSettings(MaskSettings):
    """trust: certainty below which the input's phase is kept where it explains the image better; weights that tell no
    certainty are trusted where they explain the image at least as well. misfit_gain: by how much better, as a ratio.
    """

    trust: float = 0.7
    misfit_gain: float = 0.8


class RefinedFourierTransform(SingleExposure):
    """See ``SingleExposure`` for rig and depth_range.

    weights: name of shipped weights or a path (``find_weights``), None for the default. Raises RefinerError where they
    cannot be read, and, on extraction, where they are for other fringes than the capture's.
    """

    name = "refiner"

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        weights: str | None = None,
        settings: RefinementSettings | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = settings or RefinementSettings()
        super().__init__(rig, depth_range, self.settings, device)
        self.wft = WindowedFourierTransform(rig, depth_range, device=device)
        self.folder = find_weights(weights)
        self.network, self.record = _loaded(self.folder, str(self.device), _version(self.folder))

    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        estimates = [self.estimate(image[None], field, periods) for image, field in zip(images, fields, strict=True)]
        return torch.stack([e.carriers for e in estimates]), torch.stack([e.texture for e in estimates])

    def estimate(self, image: torch.Tensor, field: FringeField, periods: tuple[float, ...]) -> Estimate:
        self.record.require_periods(periods, self.folder)
        given = self.wft.estimate(image, field, periods)
        with torch.inference_mode():
            refined = self.network(RefinerInput(image[None], given.carriers[None]))
        certainty = refined.length[0].amin(dim=0).clamp(max=1.0) if self.record.foretells_certainty else None
        carriers = self._believed(image[0], given, refined.carriers[0], certainty)
        return Estimate(carriers, given.texture, certainty)

    def _believed(
        self, image: torch.Tensor, given: Estimate, refined: torch.Tensor, certainty: torch.Tensor | None
    ) -> torch.Tensor:
        """The refined carriers, but the given ones where these are the better guess."""
        before = misfit_of(image, given.carriers, given.texture)
        after = misfit_of(image, refined, given.texture)
        doubted = before < self.settings.misfit_gain * after
        if certainty is not None:
            doubted &= certainty < self.settings.trust
        return torch.where(doubted, given.carriers, refined)


@lru_cache(maxsize=4)
def _loaded(folder: Path, device: str, version: tuple[int, ...]) -> tuple[Refiner, WeightsRecord]:
    network, record = load_weights(folder)
    return network.to(device), record


def _version(folder: Path) -> tuple[int, ...]:
    """Tells apart weights that took one another's place at a path; empty where there are none to read."""
    try:
        found = [(folder / name).stat() for name in (TENSORS_NAME, RECORD_NAME)]
    except OSError:
        return ()
    return tuple(number for status in found for number in (status.st_mtime_ns, status.st_size))
