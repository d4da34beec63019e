"""Reflection to a multiple of the network's stride, for images of any size, even smaller than the padding."""

from __future__ import annotations

import torch


def padded(values: torch.Tensor, multiple: int) -> torch.Tensor:
    """(..., H, W) continued on the right and below by reflection at the last pixel to multiples of ``multiple``."""
    for axis in (-2, -1):
        length = values.shape[axis]
        target = -(-length // multiple) * multiple
        if target != length:
            values = values.index_select(axis, _reflected(length, target, values.device))
    return values


def _reflected(length: int, target: int, device: torch.device) -> torch.Tensor:
    """Index of the pixel shown at each of ``target`` places; the edge itself is not repeated."""
    period = max(2 * (length - 1), 1)
    place = torch.arange(target, device=device) % period
    return torch.minimum(place, period - place) if length > 1 else torch.zeros_like(place)
