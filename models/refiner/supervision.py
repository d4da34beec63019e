"""Losses against known phases: the simulator's, or those of points that the rig's three devices agreed on."""

from __future__ import annotations

import torch

from models.refiner.differences import mean_over
from models.refiner.fields import RefinedPhase

_CHORD_EPSILON = 0.02
_BACKGROUND = 0.25


def phasor_loss(refined: RefinedPhase, target: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Distance of the refined phasors from known ones, a scalar.

    target: complex64 (B, 2, H, W), unit phasors, 0 where a pixel carries no phase. known: bool (B, 1, H, W).
    Two parts: the chord |exp(i phase) - target|, robust like an absolute error, where there is a phase; and the square
    of |length exp(i phase) - target| everywhere, whose minimum is the mean phasor given the image: its length is
    the certainty of the phase.
    """
    told = known.expand_as(target) & (target.abs() > 0.5)
    unit = refined.carriers / refined.modulus.clamp(min=1e-12)
    chord = (_square(unit - target) + _CHORD_EPSILON**2).sqrt() - _CHORD_EPSILON
    foretold = _square(refined.length * unit - target)
    weight = torch.where(target.abs() > 0.5, 1.0, _BACKGROUND)
    return mean_over(chord, told) + mean_over(weight * foretold, known)


def modulus_loss(
    refined: RefinedPhase, target: torch.Tensor, known: torch.Tensor, image: torch.Tensor, texture: torch.Tensor
) -> torch.Tensor:
    """eq:image_reconstruction under known phases: what is left to be wrong are the moduli. Relative to the fringes'
    amplitude, so that dark surfaces count as much as bright ones.

    image, texture: float32 (B, 1, H, W); the others as for ``phasor_loss``.
    """
    lit = known & (target.abs() > 0.5).all(dim=1, keepdim=True)
    rebuilt = texture + (refined.modulus * target.real).sum(dim=1, keepdim=True)
    amplitude = refined.modulus.detach().sum(dim=1, keepdim=True).clamp(min=0.01)
    return mean_over((rebuilt - image).abs() / amplitude, lit)


def _square(values: torch.Tensor) -> torch.Tensor:
    return values.real.square() + values.imag.square()
