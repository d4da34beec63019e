"""The image as dark and bright surfaces show it alike: less its local mean, over its local deviation."""

from __future__ import annotations

import torch

WINDOW = 31
"""Side of the window, px: two fringes of the coarse carrier and more."""
FLOOR = 0.004
"""Deviation, share of full scale, below which there is nothing but noise to be made visible."""


def locally_normalised(image: torch.Tensor) -> torch.Tensor:
    """(B, 1, H, W) float32 for an image of that shape, about -2..2 on fringes of any brightness.

    Windows are cut at the image's border.
    """
    mean = _window_mean(image)
    deviation = (_window_mean((image - mean).square()) + FLOOR**2).sqrt()
    return (image - mean) / deviation


def _window_mean(values: torch.Tensor) -> torch.Tensor:
    half = WINDOW // 2
    for kernel, padding in (((1, WINDOW), (0, half)), ((WINDOW, 1), (half, 0))):
        values = torch.nn.functional.avg_pool2d(values, kernel, 1, padding, count_include_pad=False)
    return values
