"""Fringes on planes, whose phases and slopes are known exactly."""

from __future__ import annotations

import math

import torch

PERIODS = (9.0, 14.0)


def plane(period_px: float, tilt: float = 0.0, size: tuple[int, int] = (40, 48), modulus: float = 0.1) -> torch.Tensor:
    """Carriers complex64 (1, 2, H, W) of a plane on which the high fringe is ``period_px`` wide along the gradient,
    which points ``tilt`` rad away from x."""
    height, width = size
    x = torch.arange(width, dtype=torch.float64)
    y = torch.arange(height, dtype=torch.float64)[:, None]
    columns = PERIODS[0] * (x * math.cos(tilt) + y * math.sin(tilt)) / period_px
    phase = torch.stack([2 * math.pi * columns / period for period in PERIODS])[None]
    return torch.polar(torch.full_like(phase, modulus), phase).to(torch.complex64)


def everywhere(carriers: torch.Tensor) -> torch.Tensor:
    """All pixels lit."""
    return torch.ones_like(carriers.real[:, :1], dtype=torch.bool)
