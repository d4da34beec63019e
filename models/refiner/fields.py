"""What goes into the refiner and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from models.refiner.errors import RefinerError


@dataclass(frozen=True, eq=False)
class RefinerInput:
    """A batch of views with the phases that are to be refined.

    image: float32 (B, 1, H, W), composite exposure divided by its white level, the value of a pixel at the
    sensor's full scale; images of ``Capture.stack`` are such shares already. carriers: complex64 (B, 2, H, W), high
    carrier first, divided by the same level, as in ``FringePhase``: under the composite |z| is at most about 0.25.
    Raises RefinerError for other shapes or types.
    """

    image: torch.Tensor
    carriers: torch.Tensor

    def __post_init__(self) -> None:
        image, carriers = self.image, self.carriers
        if image.dtype != torch.float32 or image.ndim != 4 or image.shape[1] != 1 or 0 in image.shape:
            raise RefinerError(
                f"refiner: image must be float32 (batch, 1, height, width), got {_described(image)}; divide by white"
            )
        if carriers.dtype != torch.complex64 or carriers.shape != (image.shape[0], 2, *image.shape[2:]):
            raise RefinerError(
                f"refiner: carriers must be complex64 (batch, 2, height, width) of the image's size "
                f"{tuple(image.shape)}, got {_described(carriers)}; give the high and the low carrier"
            )


@dataclass(frozen=True, eq=False)
class RefinedPhase:
    """Refined carriers, complex64 (B, 2, H, W), and their modulus, float32 (B, 2, H, W), shares of the white level.

    The carriers are modulus times a unit phasor. Where the input had no modulation at all the phasor may be shorter.
    length: float32 (B, 2, H, W), of the phasor before it was projected on the unit circle. A network that was trained
    to foretell phasors (``phasor_loss``) makes it the certainty of the phase: 1 when sure, 0 where there is none.
    """

    carriers: torch.Tensor
    modulus: torch.Tensor
    length: torch.Tensor

    @classmethod
    def of(cls, carriers: torch.Tensor) -> RefinedPhase:
        """Carriers that nobody refined."""
        modulus = carriers.abs()
        return cls(carriers, modulus, torch.ones_like(modulus))


def _described(tensor: torch.Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} {tuple(tensor.shape)}"
