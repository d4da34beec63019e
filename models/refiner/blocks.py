"""U-Net parts. No layer normalises over the image: what a crop or a black background does must not reach elsewhere."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import nn

SLOPE = 0.1
"""Of the leaky rectifier, whose gain the initialisation of the weights uses."""


def convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1)


def rectified(values: torch.Tensor) -> torch.Tensor:
    return nn.functional.leaky_relu(values, SLOPE, inplace=True)


class Residual(nn.Module):
    """x + two 3x3 convolutions of x."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = convolution(width, width)
        self.second = convolution(width, width)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return rectified(self.second(rectified(self.first(values))).add_(values))


class Encoder(nn.Module):
    """Features of every level, finest first (eq:encoder_features); each level halves the resolution of the one before.

    The finest level is a single convolution: there a layer costs four times what it costs below.
    """

    def __init__(self, inputs: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.stem = convolution(inputs, widths[0])
        self.halvings = nn.ModuleList(convolution(fine, coarse, stride=2) for fine, coarse in pairwise(widths))
        self.levels = nn.ModuleList(Residual(width) for width in widths[1:])

    def forward(self, values: torch.Tensor) -> list[torch.Tensor]:
        features = [rectified(self.stem(values))]
        for halving, level in zip(self.halvings, self.levels, strict=True):
            features.append(level(rectified(halving(features[-1]))))
        return features


class Decoder(nn.Module):
    """From the bottleneck back to the finest level (eq:decoder_residuals).

    Coarse features and skips are brought to the level's width by 1x1 convolutions and added, which costs a fraction of
    convolving both together. ``last`` starts at zero: an untrained head says "no change".
    """

    def __init__(self, bottleneck: int, skips: tuple[int, ...], widths: tuple[int, ...], outputs: int) -> None:
        super().__init__()
        above = (*widths[1:], bottleneck)
        self.raised = nn.ModuleList(nn.Conv2d(coarse, width, 1) for coarse, width in zip(above, widths, strict=True))
        self.joined = nn.ModuleList(nn.Conv2d(skip, width, 1) for skip, width in zip(skips, widths, strict=True))
        self.levels = nn.ModuleList(Residual(width) for width in widths)
        self.last = convolution(widths[0], outputs)

    def forward(self, bottleneck: torch.Tensor, skips: list[torch.Tensor]) -> torch.Tensor:
        values = bottleneck
        steps = zip(self.raised, self.joined, self.levels, skips, strict=True)
        for raised, joined, level, skip in reversed(list(steps)):
            coarse = nn.functional.interpolate(raised(values), scale_factor=2.0, mode="nearest")
            values = level(rectified(joined(skip).add_(coarse)))
        return torch.as_tensor(self.last(values))
