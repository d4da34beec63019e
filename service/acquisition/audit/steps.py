"""Do the fringe orders step by one from fringe to fringe? The test of a code that has no second carrier beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from service.acquisition.audit.axes import Axis, ComplexArray, FloatArray, IntArray
from service.acquisition.audit.order import CLEAR, decode_orders

GENTLE = np.pi / 2
"""Largest phase step between neighbouring pixels that is followed."""


@dataclass(frozen=True, eq=False)
class FringeSteps:
    """Per plane: how often it changed along the rows, and the share of those changes at which the decoded column
    moved on as the phase did."""

    count: FloatArray
    share: FloatArray


def fringe_steps(
    axis: Axis, field: ComplexArray, readings: FloatArray, used: IntArray, lit: npt.NDArray[np.bool_]
) -> FringeSteps:
    """Follow the phase along rows. field: (rows, width). readings: (planes, rows, width). lit: bool (rows, width)."""
    phase = np.angle(field)
    step = np.angle(field[:, 1:] * field[:, :-1].conj())
    followed = lit[:, 1:] & lit[:, :-1] & (np.abs(step) < GENTLE)
    zero = np.zeros((len(phase), 1))
    travelled = np.concatenate([zero, np.cumsum(np.where(followed, step, 0.0), axis=1)], axis=1)
    run = np.cumsum(np.concatenate([np.ones_like(zero), ~followed], axis=1).ravel())
    clear = (lit & (np.abs(readings) > CLEAR).all(axis=0)).ravel()
    at = np.flatnonzero(clear)
    flat = readings.reshape(len(readings), -1)[:, at]
    orders = decode_orders(axis, [field.ravel()[at]], flat, used, np.pi)
    period = axis.carriers[0].period
    expected = np.diff(travelled.ravel()[at]) * (period / (2 * np.pi))
    same_run = np.diff(run[at]) == 0
    right = np.abs(np.diff(orders.column) - expected) < period / 2
    changes = (np.diff(np.sign(flat), axis=1) != 0) & same_run
    count = changes.sum(axis=1).astype(np.float64)
    return FringeSteps(count, (changes & right).sum(axis=1) / np.maximum(count, 1))
