"""Cancelling what one carrier's transform hears of the other carrier and of the texture."""

from __future__ import annotations

from collections.abc import Callable

import torch

from models.phase.windowed_fourier import low_pass

Transform = Callable[[int, torch.Tensor], torch.Tensor]


def cancel_leakage(
    images: torch.Tensor, carriers: int, transform: Transform, rounds: int, background_sigma: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Carriers complex64 (V, C, H, W) and background float32 (V, H, W) of images (V, H, W).

    transform: from a carrier's index and float32 (V, H, W), what it is to be found in, to its complex field of the same
    shape. Each carrier is transformed ``rounds`` times, from the image less the background and less the other carriers
    as last found. The coarsest, last in the list, goes first: its atoms are long and so narrow in frequency, and hear
    little of the others. background_sigma: px, of the low pass that tells the background.
    """
    margin = int(min(2 * background_sigma, min(images.shape[-2:]) / 4))
    background = low_pass(images, background_sigma, margin)
    found = torch.zeros(len(images), carriers, *images.shape[1:], dtype=torch.complex64, device=images.device)
    for _ in range(rounds):
        for index in reversed(range(carriers)):
            others = found.real.sum(dim=1) - found[:, index].real
            found[:, index] = transform(index, images - background - others)
        background = low_pass(images - found.real.sum(dim=1), background_sigma, margin)
    return found, background
