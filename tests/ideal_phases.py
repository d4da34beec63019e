"""Phases of planes as a perfect decoder would return them, with the truth beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from models.geometry.device import Device
from models.geometry.rig import Rig, Side
from models.phase.fringe import FringePhase


@dataclass(frozen=True)
class Patch:
    """A plane z = depth + slope_x x + slope_y y, mm, cut to x and y limits in mm (left-camera frame)."""

    depth: float
    slope_x: float = 0.0
    slope_y: float = 0.0
    x: tuple[float, float] = (-1e4, 1e4)
    y: tuple[float, float] = (-1e4, 1e4)


def surface_points(patches: Sequence[Patch], device: Device) -> np.ndarray:
    """Nearest point (H, W, 3) that each pixel of a device sees, NaN where none."""
    rays, centre = device.rays(device.pixel_grid()), device.centre
    best = np.full((device.height, device.width, 3), np.nan)
    nearest = np.full((device.height, device.width), np.inf)
    for p in patches:
        normal = np.array([-p.slope_x, -p.slope_y, 1.0])
        scale = (p.depth - centre @ normal) / (rays @ normal)
        points = centre + rays * scale[..., None]
        hit = (scale > 0) & (scale < nearest)
        hit &= (points[..., 0] > p.x[0]) & (points[..., 0] < p.x[1])
        hit &= (points[..., 1] > p.y[0]) & (points[..., 1] < p.y[1])
        best[hit], nearest[hit] = points[hit], scale[hit]
    return best


def ideal_phases(
    rig: Rig,
    patches: Sequence[Patch],
    *,
    periods: tuple[float, ...] = (9.0, 14.0),
    noise: float = 0.0,
    columns: bool = False,
    modulation: float = 0.2,
) -> tuple[dict[Side, FringePhase], np.ndarray]:
    """Phases of both views, without shadows, and the true points (H, W, 3) of the left sensor.

    noise: rad, standard deviation of the phases. columns: with absolute columns, as Gray planes give.
    """
    assert rig.projector is not None
    rng = np.random.default_rng(0)
    phases: dict[Side, FringePhase] = {}
    for side, camera in rig.cameras.items():
        points = surface_points(patches, camera)
        column = rig.projector.project(points)[..., 0]
        seen = np.isfinite(column)
        angles = np.stack([2 * np.pi * np.nan_to_num(column) / p for p in periods])
        angles += rng.normal(0, noise, angles.shape)
        carriers = torch.from_numpy((modulation * seen * np.exp(1j * angles)).astype(np.complex64))
        phases[side] = FringePhase(
            carriers,
            torch.from_numpy(np.where(seen, 0.4, 0.02).astype(np.float32)),
            torch.from_numpy(np.where(seen, 0, 1).astype(np.uint8)),
            periods,
            column=torch.from_numpy(column.astype(np.float32)) if columns else None,
        )
    return phases, surface_points(patches, rig.left)
