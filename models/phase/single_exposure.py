"""What all methods share that take the phases of both carriers from one composite exposure."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch

from models.capture import Capture
from models.geometry.rig import Rig, Side
from models.patterns import PatternKind
from models.phase.bands import FringeField, fringe_field, spectral_field
from models.phase.fringe import FringePhase
from models.phase.nstep import SATURATION
from models.points import Reason


@dataclass(frozen=True, kw_only=True)
class MaskSettings:
    """Which pixels carry no phase.

    minimum_modulation: share of full scale below which a phase is noise. largest_misfit: ``FringePhase.misfit`` above
    which a pixel carries no phase. darkest: share of the brightness that texture and fringes predict within a fringe,
    below which a pixel is unlit: a window smears fringes over the dark beside an object. least_certainty: below which a
    method that tells its certainty gives no phase; it then needs neither misfit nor brightness.
    """

    minimum_modulation: float = 0.001
    largest_misfit: float = 4.0
    darkest: float = 0.35
    least_certainty: float = 0.1


@dataclass(frozen=True, eq=False)
class Estimate:
    """One view before it is judged. carriers: complex64 (C, H, W), phase growing along x. texture: float32 (H, W).
    certainty: float32 (H, W), of a method that foretells its own errors (``FringePhase.certainty``), else None.
    """

    carriers: torch.Tensor
    texture: torch.Tensor
    certainty: torch.Tensor | None = None


class SingleExposure(ABC):
    """``PhaseExtractor`` for one composite exposure; a method tells how the carriers are parted.

    rig, depth_range: from which the bands are derived; without a projector calibration the bands come from the
    spectrum's peaks, one for all views.
    """

    name: str

    def __init__(
        self,
        rig: Rig | None,
        depth_range: tuple[float, float] | None,
        masking: MaskSettings,
        device: torch.device | str,
    ) -> None:
        self.rig = rig
        self.depth_range = depth_range
        self.masking = masking
        self.device = torch.device(device)

    @abstractmethod
    def separate_views(
        self, images: torch.Tensor, fields: Sequence[FringeField], periods: tuple[float, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Carriers complex64 (V, C, H, W), phase growing along x, and texture float32 (V, H, W).

        images: float32 (V, H, W), share of full scale. fields: one a view.
        """

    def required_kinds(self) -> frozenset[PatternKind]:
        return frozenset({"composite"})

    def extract(self, capture: Capture) -> Mapping[Side, FringePhase]:
        capture.require(self.required_kinds(), f"method {self.name}")
        pattern = capture.plan.of_kind("composite")[0]
        phases = {}
        for side in capture.sides:
            image = torch.from_numpy(capture.stack(side, "composite")).to(self.device)
            field = self.field(side, image[0], pattern.periods)
            estimate = self.estimate(image, field, pattern.periods)
            phases[side] = self._phase(image[0], field, estimate, pattern.periods, pattern.phase_offsets)
        return phases

    def estimate(self, image: torch.Tensor, field: FringeField, periods: tuple[float, ...]) -> Estimate:
        """Of one view (1, H, W): background, borders and banks follow the view's own fringes."""
        carriers, texture = self.separate_views(image, [field], periods)
        return Estimate(carriers[0], texture[0])

    def field(self, side: Side, image: torch.Tensor, periods: tuple[float, ...]) -> FringeField:
        """Where a view's fringes lie in its spectrum: by the calibration, else by the peaks of the image (H, W)."""
        if self.rig is not None:
            field = _rig_field(self.rig, side, self.depth_range or self.rig.working_depths)
            if field is not None:
                return field
        return spectral_field(image.cpu().numpy(), periods)

    def _phase(
        self,
        image: torch.Tensor,
        field: FringeField,
        estimate: Estimate,
        periods: tuple[float, ...],
        offsets: tuple[float, ...],
    ) -> FringePhase:
        rules = self.masking
        carriers, texture, certainty = estimate.carriers, estimate.texture, estimate.certainty
        oriented = carriers if field.sign > 0 else carriers.conj().resolve_conj()
        turn = torch.polar(torch.ones(len(offsets)), torch.tensor(offsets)).to(self.device)
        mask = torch.zeros(image.shape, dtype=torch.uint8, device=self.device)
        mask[(carriers.abs() < rules.minimum_modulation).any(dim=0)] = Reason.LOW_MODULATION
        if certainty is None:
            misfit = misfit_of(image, carriers, texture)
            brightest = _brightest_nearby(image, fringe_px(field, max(periods)))
            mask[brightest < rules.darkest * (texture + carriers.abs().sum(dim=0))] = Reason.UNLIT
            mask[misfit > rules.largest_misfit] = Reason.LOW_MODULATION
        else:
            misfit = (-2 * certainty.clamp(1e-4, 1).log()).sqrt()
            mask[certainty < rules.least_certainty] = Reason.LOW_MODULATION
        mask[image >= SATURATION] = Reason.SATURATED
        return FringePhase(oriented * turn[:, None, None], texture, mask, periods, misfit, certainty=certainty)


def fringe_px(field: FringeField, period: float) -> float:
    """Length of a fringe of this period (columns) along the image's rows, px."""
    return 2 * torch.pi * period / field.zeta[1]


@lru_cache(maxsize=16)
def _rig_field(rig: Rig, side: Side, depth_range: tuple[float, float]) -> FringeField | None:
    return fringe_field(rig, rig.cameras[side], depth_range)


def _brightest_nearby(image: torch.Tensor, length: float) -> torch.Tensor:
    """Largest value within a fringe along the row, (H, W)."""
    half = min(round(length / 2), image.shape[1] // 2)
    return torch.nn.functional.max_pool2d(image[None, None], (1, 2 * half + 1), stride=1, padding=(0, half))[0, 0]


def misfit_of(image: torch.Tensor, carriers: torch.Tensor, texture: torch.Tensor) -> torch.Tensor:
    """See ``FringePhase.misfit``; means over 5x5 pixels."""
    unexplained = (image - texture - carriers.real.sum(dim=0)) ** 2
    expected = 0.5 * (carriers.abs() ** 2).sum(dim=0)
    means = torch.nn.functional.avg_pool2d(
        torch.stack([unexplained, expected])[:, None], 5, stride=1, padding=2, count_include_pad=False
    )[:, 0]
    return (means[0] / means[1].clamp(min=1e-12)).sqrt()
