"""N-step phase shifting: the complex sum over the steps (reference decoding)."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from models.errors import CaptureError
from models.patterns import Pattern


def demodulate(stack: torch.Tensor, patterns: Sequence[Pattern]) -> torch.Tensor:
    """Complex field of one carrier: angle 2 pi u / period mod 2 pi, absolute value the modulation.

    z = (2/N) sum_k I_k exp(+i s 2 pi k / N) exp(i offset), with the shift sign s and offset of the patterns.
    stack: float32 (N, H, W), share of full scale, in the order of ``patterns``. Returns complex64 (H, W).
    Raises CaptureError when the patterns are not the whole set of one carrier.
    """
    first = patterns[0]
    if first.steps != len(patterns) or {p.step for p in patterns} != set(range(len(patterns))):
        raise CaptureError(f"phase steps of '{first.kind}' are incomplete: {len(patterns)} of {first.steps}")
    steps = torch.tensor([float(p.step or 0) for p in patterns], device=stack.device)
    angle = first.shift_sign * 2 * torch.pi * steps / len(patterns) + first.phase_offsets[0]
    weights = torch.polar(torch.full_like(angle, 2 / len(patterns)), angle)
    real = torch.tensordot(weights.real, stack, dims=1)
    imaginary = torch.tensordot(weights.imag, stack, dims=1)
    return torch.complex(real, imaginary)
