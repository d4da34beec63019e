"""Differences between neighbouring pixels that do not look at dark ones.

Maps keep the size of the image; a bool map beside them tells where all pixels involved are lit. Elsewhere a value is a
constant, so that neither it nor its gradient depends on the dark.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

SMALLEST_MAGNITUDE = 1e-4
"""What ``Gradient.magnitude`` reads where nothing varies."""
GradientForm = Literal["argument", "central"]


@dataclass(frozen=True, eq=False)
class Gradient:
    """Along x and along y, float32 (B, C, H, W) each; valid: bool (B, C, H, W) or (B, 1, H, W)."""

    x: torch.Tensor
    y: torch.Tensor
    valid: torch.Tensor

    def magnitude(self) -> torch.Tensor:
        """eq:phase_grad_mag_hat."""
        return (self.x.square() + self.y.square() + SMALLEST_MAGNITUDE**2).sqrt()


def next_along(values: torch.Tensor, axis: int) -> torch.Tensor:
    """The following pixel's value at each pixel; the last pixel sees itself."""
    length = values.shape[axis]
    return torch.cat([values.narrow(axis, 1, length - 1), values.narrow(axis, length - 1, 1)], dim=axis)


def previous_along(values: torch.Tensor, axis: int) -> torch.Tensor:
    """The preceding pixel's value at each pixel; the first pixel sees itself."""
    return torch.cat([values.narrow(axis, 0, 1), values.narrow(axis, 0, values.shape[axis] - 1)], dim=axis)


def forward_gradient(values: torch.Tensor, valid: torch.Tensor) -> Gradient:
    """Differences to the right and below of (B, C, H, W), where the pixel and both neighbours are valid."""
    whole = _with_next(valid)
    values = torch.where(valid, values, torch.zeros_like(values))
    x, y = (torch.where(whole, next_along(values, axis) - values, 0.0) for axis in (-1, -2))
    return Gradient(x, y, whole)


def phase_gradient(carriers: torch.Tensor, lit: torch.Tensor, form: GradientForm = "argument") -> Gradient:
    """Gradient of the phase of complex64 (B, C, H, W), rad/px; no modulus enters it. lit: bool (B, 1, H, W).

    argument: arg(z(x+1) conj z(x)), exact on planes up to half a turn a pixel. central: C dS - S dC with central
    differences (eq:phase_grad_from_sincos_hat as commonly written), which reads sin(g) where the slope is g.
    """
    phasors = _phasors(carriers, lit)
    if form == "central":
        whole = _with_next(lit) & _with_previous(lit)
        x, y = (
            torch.where(whole, ((next_along(phasors, a) - previous_along(phasors, a)) / 2 * phasors.conj()).imag, 0.0)
            for a in (-1, -2)
        )
    else:
        whole = _with_next(lit)
        x, y = (torch.where(whole, _turn(phasors, axis), 0.0) for axis in (-1, -2))
    return Gradient(x, y, whole)


def mean_over(values: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Mean over valid places, a scalar; 0 where there is none."""
    valid = valid.expand_as(values)
    return torch.where(valid, values, 0.0).sum() / valid.sum().clamp(min=1)


def _phasors(carriers: torch.Tensor, lit: torch.Tensor) -> torch.Tensor:
    """Unit phasors; 1 in the dark."""
    lit = lit.expand(carriers.shape)
    real = torch.where(lit, carriers.real, 1.0)
    imaginary = torch.where(lit, carriers.imag, 0.0)
    length = (real.square() + imaginary.square() + 1e-12).sqrt()
    return torch.complex(real / length, imaginary / length)


def _turn(phasors: torch.Tensor, axis: int) -> torch.Tensor:
    product = next_along(phasors, axis) * phasors.conj()
    # The argument's gradient grows without bound towards 0; a pair with no phase has no turn.
    known = product.real.square() + product.imag.square() > 1e-4
    return torch.atan2(torch.where(known, product.imag, 0.0), torch.where(known, product.real, 1.0))


def _with_next(valid: torch.Tensor) -> torch.Tensor:
    whole = valid & next_along(valid, -1) & next_along(valid, -2)
    whole[..., -1, :] = False
    whole[..., :, -1] = False
    return whole


def _with_previous(valid: torch.Tensor) -> torch.Tensor:
    whole = valid & previous_along(valid, -1) & previous_along(valid, -2)
    whole[..., 0, :] = False
    whole[..., :, 0] = False
    return whole
