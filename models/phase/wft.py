"""The single-shot method without learning: windowed Fourier filtering of both carriers, with their leakage cancelled.

A window small enough to follow an object is wide in frequency: at sigma = 6 px the high band hears the low carrier.
Each carrier is therefore filtered from the image less the other carrier and less the background, and again with
the better estimates; leakage falls by the window's rejection each time round.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.capture import Capture
from models.geometry.rig import Rig, Side
from models.patterns import PatternKind
from models.phase.bands import FringeField, carrier_bands, fringe_field, spectral_field
from models.phase.fringe import FringePhase
from models.phase.nstep import SATURATION
from models.phase.windowed_fourier import Band, Spectrum, Threshold, WindowedFourierFilter, low_pass
from models.points import Reason


@dataclass(frozen=True)
class WftSettings:
    """Settings of the method ``wft``.

    window: standard deviation of the Gaussian window in fringes of the carrier (px = window * period in the image).
    rounds: filterings of each carrier; 1 is the plain filter. noise, first_relative, relative: see ``Threshold``; the
    first round is more selective because it hears the other carrier. minimum_modulation: share of full scale
    below which a phase is noise. largest_misfit: ``FringePhase.misfit`` above which a pixel carries no phase.
    darkest: share of the brightness that texture and fringes predict within a fringe, below which a pixel is unlit: the
    window smears fringes over the dark beside an object.
    """

    window: float = 0.4
    rounds: int = 4
    noise: float = 2.0
    first_relative: float = 0.5
    relative: float = 0.2
    minimum_modulation: float = 0.001
    largest_misfit: float = 4.0
    darkest: float = 0.35


class WindowedFourierTransform:
    """``PhaseExtractor`` for one composite exposure.

    rig, depth_range: from which the bands are derived; without a projector calibration the bands come from the
    spectrum's peaks, one for all views.
    """

    name = "wft"

    def __init__(
        self,
        rig: Rig | None = None,
        depth_range: tuple[float, float] | None = None,
        settings: WftSettings | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        self.rig = rig
        self.depth_range = depth_range
        self.settings = settings or WftSettings()
        self.device = torch.device(device)

    def required_kinds(self) -> frozenset[PatternKind]:
        return frozenset({"composite"})

    def extract(self, capture: Capture) -> Mapping[Side, FringePhase]:
        capture.require(self.required_kinds(), "method wft")
        periods = capture.plan.of_kind("composite")[0].periods
        offsets = capture.plan.of_kind("composite")[0].phase_offsets
        phases = {}
        for side in capture.sides:
            image = torch.from_numpy(capture.stack(side, "composite")).to(self.device)
            field = self._field(side, image[0], periods)
            phases[side] = self._view(image, field, periods, offsets)
        return phases

    def _field(self, side: Side, image: torch.Tensor, periods: tuple[float, ...]) -> FringeField:
        if self.rig is not None:
            field = _rig_field(self.rig, side, self.depth_range or self.rig.working_depths)
            if field is not None:
                return field
        return spectral_field(image.cpu().numpy(), periods)

    def _view(
        self, image: torch.Tensor, field: FringeField, periods: tuple[float, ...], offsets: tuple[float, ...]
    ) -> FringePhase:
        bands = carrier_bands(field, periods)
        sigmas = [self.settings.window * 2 * torch.pi * period / field.zeta[1] for period in periods]
        margin = int(min(2 * max(sigmas), min(image.shape[-2:]) / 4))
        fringe_px = 2 * torch.pi * max(periods) / field.zeta[1]
        carriers, texture = separate(image, bands, sigmas, margin, self.settings)
        oriented = carriers if field.sign > 0 else carriers.conj().resolve_conj()
        turn = torch.polar(torch.ones(len(offsets)), torch.tensor(offsets)).to(self.device)
        mask = torch.zeros(image.shape[1:], dtype=torch.uint8, device=self.device)
        mask[(carriers.abs() < self.settings.minimum_modulation).any(dim=0)] = Reason.LOW_MODULATION
        misfit = _misfit(image[0], carriers, texture)
        mask[_brightest_nearby(image[0], fringe_px) < self.settings.darkest * (texture + carriers.abs().sum(dim=0))] = (
            Reason.UNLIT
        )
        mask[misfit > self.settings.largest_misfit] = Reason.LOW_MODULATION
        mask[image[0] >= SATURATION] = Reason.SATURATED
        return FringePhase(oriented * turn[:, None, None], texture, mask, periods, misfit)


@lru_cache(maxsize=16)
def _rig_field(rig: Rig, side: Side, depth_range: tuple[float, float]) -> FringeField | None:
    return fringe_field(rig, rig.cameras[side], depth_range)


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


def _brightest_nearby(image: torch.Tensor, fringe_px: float) -> torch.Tensor:
    """Largest value within a fringe along the row, (H, W)."""
    half = min(round(fringe_px / 2), image.shape[1] // 2)
    return torch.nn.functional.max_pool2d(image[None, None], (1, 2 * half + 1), stride=1, padding=(0, half))[0, 0]


def _misfit(image: torch.Tensor, carriers: torch.Tensor, texture: torch.Tensor) -> torch.Tensor:
    """See ``FringePhase.misfit``; means over 5x5 pixels."""
    unexplained = (image - texture - carriers.real.sum(dim=0)) ** 2
    expected = 0.5 * (carriers.abs() ** 2).sum(dim=0)
    means = torch.nn.functional.avg_pool2d(
        torch.stack([unexplained, expected])[:, None], 5, stride=1, padding=2, count_include_pad=False
    )[:, 0]
    return (means[0] / means[1].clamp(min=1e-12)).sqrt()


def _apply(image: torch.Tensor, band: Band, sigma: float, margin: int, threshold: Threshold) -> torch.Tensor:
    spectrum = Spectrum(image, margin)
    padded = (spectrum.values.shape[-2], spectrum.values.shape[-1])
    return _filter(padded, band, sigma)(spectrum, threshold)
