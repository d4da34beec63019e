"""Fringe orders from code planes and phases together, and whether they agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from service.acquisition.audit.axes import Axis, ComplexArray, FloatArray, IntArray
from service.acquisition.audit.pieces import map_pixels_transposed

LOW_PHASE_WEIGHT = 30.0
"""Least weight of 1 - cos(low phase error) against one plane read wrongly, which counts 2."""
NEIGHBOUR_COST = 3.0
"""What the order with the next best low phase must cost: more than one plane read wrongly."""
ALIAS = 0.25
"""Orders whose low phases are nearer than this (rad) are told apart by the planes alone."""
CLEAR = 0.5
"""A plane reads clearly where it is this far from the middle, as a share of the fringe's amplitude."""


@dataclass(frozen=True, eq=False)
class Orders:
    """Decoded columns of P pixels along one axis.

    column: float32, mirrors. words: int, code word of each pixel. readings: float32 (planes used, P), -1..1.
    used: which members of the code were read. low_error: rad, measured minus predicted low phase; zero without a low
    carrier. consistent: no clear plane and no low phase contradicts the column.
    """

    column: FloatArray
    words: IntArray
    readings: FloatArray
    used: IntArray
    low_error: FloatArray
    consistent: npt.NDArray[np.bool_]


def decode_orders(
    axis: Axis, fields: list[ComplexArray], readings: FloatArray, used: IntArray, low_phase: float
) -> Orders:
    """Most likely columns.

    fields: complex (P,) a carrier, high first. readings: (planes, P), of the code's members ``used``, clipped to -1..1.
    """
    code, high = axis.code, axis.carriers[0]
    assert code is not None
    signs = code.signs[used]
    in_fringe = (np.mod(np.angle(fields[0]), 2 * np.pi) * (high.period / (2 * np.pi))).astype(np.float32)
    of_words = map_pixels_transposed(readings, signs)
    if np.isclose(code.period, high.period):
        orders, score = np.arange(signs.shape[1]), of_words
    else:
        orders = np.arange(max(1, int(np.ceil(signs.shape[1] * code.period / high.period))))
        score = np.take_along_axis(of_words, _words(in_fringe[:, None] + orders * high.period, code.period, signs), 1)
    has_low = len(fields) > 1
    if has_low:
        base = np.exp(1j * (2 * np.pi / axis.carriers[1].period) * in_fringe) * _unit(fields[1]).conj()
        turns = orders * (2 * np.pi * high.period / axis.carriers[1].period)
        spacing = _spacing(turns)
        low_phase = min(low_phase, 0.75 * spacing)
        pair = max(LOW_PHASE_WEIGHT, NEIGHBOUR_COST / (1 - np.cos(spacing))) * np.stack([base.real, base.imag]).astype(
            np.float32
        )
        turned = np.stack([np.cos(turns), -np.sin(turns)]).astype(np.float32)
        score = score + map_pixels_transposed(pair, turned)
    best = score.argmax(axis=1)
    column = in_fringe + (best * high.period).astype(np.float32)
    words = _words(column, code.period, signs)
    low_error = np.zeros_like(column)
    if has_low:
        low_error = -np.angle(np.exp(1j * (2 * np.pi / axis.carriers[1].period) * column) * fields[1].conj())
    agrees = (readings * signs[:, words] > -CLEAR).all(axis=0) & (np.abs(low_error) < low_phase)
    return Orders(column, words, readings, used, low_error.astype(np.float32), agrees)


def pair_consistency(orders: Orders) -> tuple[FloatArray, FloatArray]:
    """(planes, planes): number of pixels at which two planes clearly read differently; share of them consistent."""
    bits = np.where(np.abs(orders.readings) > CLEAR, np.sign(orders.readings), 0.0).astype(np.float32)
    clear = np.abs(bits)

    def differing(weight: FloatArray) -> FloatArray:
        return np.asarray(((clear * weight) @ clear.T - (bits * weight) @ bits.T) / 2)

    count = differing(np.ones(bits.shape[1], np.float32))
    return count, differing(orders.consistent.astype(np.float32)) / np.maximum(count, 1)


def best_rotation(axis: Axis, orders: Orders, limit: int = 2000) -> tuple[int, float]:
    """Steps by which the high phase would have to be turned for its fringes to begin where the code words do.

    Returns (steps, lead of that over none as a share of full agreement of one plane). Source of the idea: a word's
    edge lies at phase 0.
    """
    code, high = axis.code, axis.carriers[0]
    assert code is not None
    thin = slice(None, None, max(1, len(orders.column) // limit))
    keep = orders.consistent[thin] if not orders.consistent[thin].all() else slice(None)
    column, readings = orders.column[thin][keep], orders.readings[:, thin][:, keep]
    if not len(column):
        return 0, 0.0
    signs = code.signs[orders.used]
    turns = np.arange(high.steps) - high.steps // 2
    agreement = [
        float((readings * signs[:, _words(column + t * high.period / high.steps, code.period, signs)]).sum())
        for t in turns
    ]
    best = int(np.argmax(agreement))
    lead = (agreement[best] - agreement[high.steps // 2]) / len(column)
    return int(turns[best]), lead


def _spacing(turns: FloatArray) -> float:
    """Smallest difference (rad) between low phases of orders that differ in it at all."""
    apart = np.abs(np.angle(np.exp(1j * turns)))
    return float(apart[apart > ALIAS].min(initial=np.pi))


def _words(column: FloatArray, period: float, signs: FloatArray) -> IntArray:
    return np.clip((column * (1 / period)).astype(np.int32), 0, signs.shape[1] - 1)


def _unit(field: ComplexArray) -> ComplexArray:
    return field / np.maximum(np.abs(field), 1e-9)
