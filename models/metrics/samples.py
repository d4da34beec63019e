"""Errors of one point map, kept as sums that add up over a split."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from models.geometry.rig import Rig
from models.metrics import histogram
from models.metrics.pseudo_phase import TURN, pseudo_unwrap
from models.metrics.reference import Reference
from models.points import PointMap

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SampleErrors:
    """Pixel counts and sums of absolute and squared errors; mm and rad.

    pixels: of the GT-valid foreground. valid: those of them that the method reconstructs. judged: those with a
    reference column, 0 without a projector; order_tolerant, order_literal: of these, pseudo-unwrapped phase within pi
    of the reference, fringe order equal to it. phase_*: over judged pixels that are valid. depth_*, beyond_3mm: over
    valid pixels. common_*: over the common mask. histogram: absolute depth errors, see ``histogram``.
    """

    pixels: int
    valid: int
    judged: int
    order_tolerant: int
    order_literal: int
    phase_pixels: int
    phase_absolute: float
    phase_square: float
    depth_absolute: float
    depth_square: float
    within_1mm: int
    within_3mm: int
    beyond_3mm: int
    common_pixels: int
    common_absolute: float
    common_square: float
    histogram: npt.NDArray[np.int64]


def common_mask(maps: Iterable[PointMap], reference: Reference, depth_range: tuple[float, float]) -> Mask:
    """Foreground pixels (H, W) that every one of the point maps reconstructs."""
    mask = reference.within(depth_range)
    for points in maps:
        mask = mask & _reconstructed(points)
    return mask


def compare_all(
    maps: Mapping[str, PointMap], reference: Reference, rig: Rig, period: float, depth_range: tuple[float, float]
) -> dict[str, SampleErrors]:
    """Errors of several methods' point maps of one sample, by method, with their common mask.

    A method that failed on the sample takes part with ``PointMap.empty``: its pixels count as invalid.
    """
    common = common_mask(maps.values(), reference, depth_range)
    return {name: compare(points, reference, rig, period, depth_range, common=common) for name, points in maps.items()}


def compare(
    points: PointMap,
    reference: Reference,
    rig: Rig,
    period: float,
    depth_range: tuple[float, float],
    *,
    common: Mask | None = None,
) -> SampleErrors:
    """Errors of one point map.

    period: of the high carrier, in projector columns. depth_range: (min, max) mm of the reference depths that count.
    common: mask (H, W) of ``common_mask``; None leaves the common figures empty. Raises ValueError when the sizes of
    map and reference differ.
    """
    if points.shape != reference.depth.shape:
        raise ValueError(f"point map is {points.shape} but its reference {reference.depth.shape}")
    foreground = reference.within(depth_range)
    valid = foreground & _reconstructed(points)
    error = _depth_errors(points, reference, valid)
    shared = _depth_errors(points, reference, np.zeros_like(valid) if common is None else valid & common)

    judged = foreground & np.isfinite(reference.column) & (rig.projector is not None)
    phase_error, same_order = _phase_errors(points, reference, rig, period, judged & valid)
    return SampleErrors(
        pixels=_number(foreground),
        valid=len(error),
        judged=_number(judged),
        order_tolerant=_number(phase_error < np.pi),
        order_literal=_number(same_order),
        phase_pixels=len(phase_error),
        phase_absolute=float(phase_error.sum()),
        phase_square=float((phase_error**2).sum()),
        depth_absolute=float(error.sum()),
        depth_square=float((error**2).sum()),
        within_1mm=_number(error < 1),
        within_3mm=_number(error < 3),
        beyond_3mm=_number(error > 3),
        common_pixels=len(shared),
        common_absolute=float(shared.sum()),
        common_square=float((shared**2).sum()),
        histogram=histogram.count(error),
    )


def _reconstructed(points: PointMap) -> Mask:
    return np.asarray(points.valid & np.isfinite(points.depth))


def _depth_errors(points: PointMap, reference: Reference, where: Mask) -> npt.NDArray[np.float64]:
    return np.abs(points.depth[where].astype(np.float64) - reference.depth[where])


def _phase_errors(
    points: PointMap, reference: Reference, rig: Rig, period: float, where: Mask
) -> tuple[npt.NDArray[np.float64], Mask]:
    """Absolute errors (n,) of the pseudo-unwrapped phase, rad, and whether its order is the reference's."""
    if rig.projector is None:
        return np.empty(0), np.empty(0, np.bool_)
    order, phase = pseudo_unwrap(points.points[where], points.phase_high[where], rig.projector, period)
    turns = reference.column[where].astype(np.float64) / period
    told = np.isfinite(phase)
    return np.abs(phase - TURN * turns)[told], (order == np.floor(turns))[told]


def _number(mask: Mask) -> int:
    return int(np.count_nonzero(mask))
