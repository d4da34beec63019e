"""What a configuration costs: weights and floating-point operations, counted layer by layer."""

from __future__ import annotations

import copy
from typing import Any

import torch
from torch import nn

from models.refiner.attention import CrossAttention
from models.refiner.fields import RefinerInput
from models.refiner.network import Refiner


def parameter_count(refiner: Refiner) -> int:
    """Numbers in the weights; times four, their bytes."""
    return sum(parameter.numel() for parameter in refiner.parameters())


def floating_point_operations(refiner: Refiner, size: tuple[int, int]) -> int:
    """Operations for one view of ``size`` (width, height): multiplications and additions of convolutions, linear layers
    and attention, each counted as one. Nothing is computed: the shapes alone are followed.
    """
    total = 0

    def convolved(layer: nn.Conv2d, _: Any, output: torch.Tensor) -> None:
        nonlocal total
        total += 2 * output.numel() * layer.in_channels * layer.kernel_size[0] * layer.kernel_size[1]

    def mapped(layer: nn.Linear, _: Any, output: torch.Tensor) -> None:
        nonlocal total
        total += 2 * output.numel() * layer.in_features

    def attended(_: nn.Module, __: Any, output: torch.Tensor) -> None:
        nonlocal total
        tokens = output.shape[-2] * output.shape[-1]
        total += 4 * tokens**2 * output.shape[1]  # scores, and their weighted sum

    shadow = copy.deepcopy(refiner).to("meta")
    for module in shadow.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(convolved)
        elif isinstance(module, nn.Linear):
            module.register_forward_hook(mapped)
        elif isinstance(module, CrossAttention):
            module.register_forward_hook(attended)
    width, height = size
    with torch.no_grad():
        shadow(
            RefinerInput(
                torch.empty(1, 1, height, width, device="meta"),
                torch.empty(1, 2, height, width, device="meta", dtype=torch.complex64),
            )
        )
    return total
