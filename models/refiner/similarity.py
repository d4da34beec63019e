"""Structural similarity (Wang et al., IEEE TIP 13(4), 2004) over the lit pixels of two images."""

from __future__ import annotations

import torch

_C1, _C2 = 0.01**2, 0.03**2  # for a range of 1
_HALF, _SIGMA = 5, 1.5


def structural_similarity(first: torch.Tensor, second: torch.Tensor, lit: torch.Tensor) -> torch.Tensor:
    """SSIM at each pixel, float32 (B, 1, H, W), of two such images; meaningful where ``lit``, bool of the same shape.

    Gaussian windows of 11x11 pixels, sigma 1.5, weigh lit pixels only: an object's rim does not see the background.
    """
    share = _windowed(lit.to(first.dtype)).clamp(min=1e-6)

    def mean(values: torch.Tensor) -> torch.Tensor:
        return _windowed(values) / share

    a, b = torch.where(lit, first, 0.0), torch.where(lit, second, 0.0)
    mean_a, mean_b = mean(a), mean(b)
    variances = mean(a * a) - mean_a.square() + mean(b * b) - mean_b.square()
    covariance = mean(a * b) - mean_a * mean_b
    luminance = (2 * mean_a * mean_b + _C1) / (mean_a.square() + mean_b.square() + _C1)
    return luminance * (2 * covariance + _C2) / (variances.clamp(min=0) + _C2)


def _windowed(values: torch.Tensor) -> torch.Tensor:
    """Gaussian sums; nothing lies beyond the border."""
    reach = torch.arange(-_HALF, _HALF + 1, device=values.device, dtype=values.dtype)
    kernel = torch.exp(-reach.square() / (2 * _SIGMA**2))
    kernel = kernel / kernel.sum()
    along_x = torch.nn.functional.conv2d(values, kernel[None, None, None, :], padding=(0, _HALF))
    return torch.nn.functional.conv2d(along_x, kernel[None, None, :, None], padding=(_HALF, 0))
