"""Gray-code decoding: planes to code words, with the runner-up word where a plane is in doubt."""

from __future__ import annotations

from dataclasses import dataclass

import torch


@dataclass(frozen=True, eq=False)
class GrayCode:
    """Decoded code words of one view, all (H, W).

    order: int64, floor(u / period). rival: int64, the word with the least certain plane flipped; neighbouring words
    differ in one plane, so at a word's edge the rival is the neighbour. margin, second_margin: float32 0..1, contrast
    of the least and second least certain plane, as a share of white minus black: 1 is a clean plane, 0 a coin toss.
    """

    order: torch.Tensor
    rival: torch.Tensor
    margin: torch.Tensor
    second_margin: torch.Tensor


def decode_gray(
    planes: torch.Tensor,
    *,
    inverse: torch.Tensor | None = None,
    white: torch.Tensor | None = None,
    black: torch.Tensor | None = None,
) -> GrayCode:
    """Decode planes (B, H, W), most significant first.

    Each plane is compared with its complement where captured, else with (white + black) / 2. The brightest or darkest
    plane at a pixel stands in for a level that is not given; pixels where all planes are alike then get margin 0.
    """
    if inverse is not None:
        contrast = planes - inverse
        span = contrast.abs().amax(dim=0)
    else:
        bright = planes.amax(dim=0) if white is None else white
        dark = planes.amin(dim=0) if black is None else black
        contrast = 2 * planes - (bright + dark)
        span = bright - dark
    bits = (contrast > 0).to(torch.int64)
    certainty = (contrast.abs() / span.clamp(min=1e-6)).clamp(max=1.0)
    certainty = torch.where(span > 1e-3, certainty, 0.0)
    least = torch.topk(certainty, min(2, len(planes)), dim=0, largest=False)
    flipped = bits.scatter(0, least.indices[:1], 1 - bits.gather(0, least.indices[:1]))
    return GrayCode(_to_binary(bits), _to_binary(flipped), least.values[0], least.values[-1])


def _to_binary(bits: torch.Tensor) -> torch.Tensor:
    """Reflected Gray code (B, H, W), most significant first, to integers (H, W)."""
    binary = torch.zeros_like(bits[0])
    previous = torch.zeros_like(bits[0])
    for plane in bits:
        previous = previous ^ plane
        binary = 2 * binary + previous
    return binary
