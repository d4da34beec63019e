"""Phases of both views on the rectified canvases, as arrays that compiled kernels take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from models.geometry.rectification import Rectification
from models.geometry.rig import Side
from models.phase.fringe import FringePhase
from models.points import Reason

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RectifiedView:
    """One view on its canvas (h, w).

    phase: float32 (C, h, w) wrapped, rad. modulation: float32 (C, h, w). texture: float32 (h, w).
    usable: bool (h, w), every sensor pixel that contributes carries a phase.
    column: float32 (h, w), absolute projector column, NaN where unknown; None without Gray planes.
    """

    phase: Float32Array
    modulation: Float32Array
    texture: Float32Array
    usable: npt.NDArray[np.bool_]
    column: Float32Array | None


def rectify_phases(phases: Mapping[Side, FringePhase], rectification: Rectification) -> dict[Side, RectifiedView]:
    """Resample both views; complex fields are interpolated (cubic), so that no phase wrap is."""
    return {side: _rectify_view(phase, rectification.maps[side]) for side, phase in phases.items()}


def _rectify_view(view: FringePhase, sensor_map: Float32Array) -> RectifiedView:
    carriers = view.carriers.cpu().numpy()
    usable = (view.mask == int(Reason.VALID)).cpu().numpy()
    if view.column is not None:
        usable = usable & np.isfinite(view.column.cpu().numpy())
    parts = [_resample(part, sensor_map) for c in carriers for part in (c.real, c.imag)]
    fields = np.stack([real + 1j * imaginary for real, imaginary in zip(parts[::2], parts[1::2], strict=True)])
    column = None
    if view.column is not None:
        filled = np.nan_to_num(view.column.cpu().numpy(), nan=0.0)
        column = _resample(filled, sensor_map, cv2.INTER_LINEAR)
    share = cv2.remap(usable.astype(np.float32), sensor_map, None, cv2.INTER_LINEAR, borderValue=0.0)
    texture = _resample(view.texture.cpu().numpy(), sensor_map)
    return RectifiedView(
        np.angle(fields).astype(np.float32), np.abs(fields).astype(np.float32), texture, share > 0.999, column
    )


def _resample(image: npt.NDArray[np.float32], sensor_map: Float32Array, method: int = cv2.INTER_CUBIC) -> Float32Array:
    contiguous = np.ascontiguousarray(image, np.float32)
    return np.asarray(cv2.remap(contiguous, sensor_map, None, method, borderMode=cv2.BORDER_REPLICATE), np.float32)
