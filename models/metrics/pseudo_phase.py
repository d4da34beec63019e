"""Fringe orders told by geometry: the pseudo-unwrapped phase that the paper evaluates with, and only evaluates with."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from models.geometry.device import Device

FloatArray = npt.NDArray[np.float64]
TURN = 2 * np.pi


def pseudo_unwrap(
    points: npt.NDArray[np.float32], phase: npt.NDArray[np.float32], projector: Device, period: float
) -> tuple[FloatArray, FloatArray]:
    """Fringe order and pseudo-unwrapped phase (rad) of points (n, 3), mm, with wrapped phases (n,), rad.

    The order is the whole number of turns that brings the phase, taken in 0..2 pi, nearest to that of the projector
    column on which the point falls (paper, "Evaluation metrics"). period: columns a fringe. NaN where either lacks.
    """
    column = projector.project(points)[:, 0]
    wrapped = np.mod(phase.astype(np.float64), TURN)
    order = np.round(column / period - wrapped / TURN)
    return order, wrapped + TURN * order
