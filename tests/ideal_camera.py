"""Patterns as an ideal camera sees them at given projector columns: no noise, no lens, no other light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from models.patterns import Pattern


def fringe_steps(steps: int, period: float, sign: int = 1, offset: float = 0.0, kind: str = "high") -> list[Pattern]:
    values: dict[str, Any] = {"kind": kind, "period": period, "shift_sign": sign, "phase_offset": offset}
    return [
        Pattern.model_validate({"name": f"{kind}_{k:02d}", "step": k, "steps": steps, **values}) for k in range(steps)
    ]


def gray_planes(bits: int, period: float, *, inverted: bool = False) -> list[Pattern]:
    kind = "gray_inv" if inverted else "gray"
    values: dict[str, Any] = {"kind": kind, "period": period, "bits": bits}
    return [Pattern.model_validate({"name": f"{kind}_{b:02d}", "bit": b, **values}) for b in range(bits)]


def shown(
    patterns: Sequence[Pattern], column: np.ndarray, albedo: float = 1.0, ambient: float = 0.0, blur: float = 0.0
) -> torch.Tensor:
    """Stack (N, *column.shape), float32, share of full scale. blur: standard deviation of the spot in columns."""
    offsets = np.linspace(-3, 3, 31) * blur if blur else np.zeros(1)
    weights = np.exp(-0.5 * (offsets / (blur or 1.0)) ** 2)
    weights /= weights.sum()
    stack = [sum(w * p.evaluate(column + o) for w, o in zip(weights, offsets, strict=True)) for p in patterns]
    return torch.from_numpy((ambient + albedo * np.stack(stack) / 255).astype(np.float32))
