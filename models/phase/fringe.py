"""What every phase method returns: one complex field a carrier, and the texture under the fringes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import torch

from models.capture import Capture
from models.geometry.rig import Side
from models.patterns import PatternKind


@dataclass(frozen=True, eq=False)
class FringePhase:
    """Phase and modulation of one view on its sensor grid (H, W).

    carriers: complex64 (C, H, W), high carrier first, C = 1 or 2: angle is the wrapped phase 2 pi u / period mod 2 pi,
    absolute value the modulation as a share of the sensor's full scale. texture: float32 (H, W), the scene without
    fringes, share of full scale. mask: uint8 (H, W), ``Reason``: UNLIT, LOW_MODULATION or SATURATED where the phase
    must not be used, else VALID. periods: fringe period of each carrier in projector columns. misfit: float32 (H, W),
    rms of what fringes and texture leave unexplained in the image nearby, as a share of the fringes' rms: near 0 on
    smooth surfaces, large at edges that the method smears over; None for methods that do not smear. column: float32
    (H, W), absolute projector column u where Gray planes tell it, NaN elsewhere; None without them. certainty: float32
    (H, W), 0..1, mean resultant length that a method foretells for its phase: 1 where it is sure, 0 where any phase is
    as likely; its misfit is then the circular standard deviation sqrt(-2 ln certainty), rad. None for other methods.
    """

    carriers: torch.Tensor
    texture: torch.Tensor
    mask: torch.Tensor
    periods: tuple[float, ...]
    misfit: torch.Tensor | None = None
    column: torch.Tensor | None = None
    certainty: torch.Tensor | None = None

    @property
    def wrapped(self) -> torch.Tensor:
        """Wrapped phases, float32 (C, H, W), radians in (-pi, pi]."""
        return torch.angle(self.carriers)

    @property
    def modulation(self) -> torch.Tensor:
        """Modulation of each carrier, float32 (C, H, W), share of full scale."""
        return self.carriers.abs()


class PhaseExtractor(Protocol):
    """Turns the images of a capture into phases; implementations: nstep, and for one exposure wft, the
    wavelets and shearlet."""

    name: str

    def required_kinds(self) -> frozenset[PatternKind]:
        """Pattern groups without which the method cannot work."""
        ...

    def extract(self, capture: Capture) -> Mapping[Side, FringePhase]:
        """Phases of every view of the capture; raises CaptureError when a needed group is absent."""
        ...
