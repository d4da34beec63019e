"""Labels that cost no exposure: what the three devices agreed on tells every pixel its projector column.

A point that both cameras and the projector accept lies where two lines of sight cross. Its projection into the
projector is the column that both views should have seen there; errors of the phases it was matched by enter only
by way of its depth, where those common to both views cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from models.capture import Capture
from models.errors import CalibrationError, ReconstructionError
from models.geometry.rig import Rig, Side
from models.points import PointMap, Reason
from models.reconstruct import Method, ReconstructionOptions, reconstruct

_UNKNOWN = np.float32(np.inf)
_NO_LIGHT = np.float32(np.nan)


@dataclass(frozen=True)
class GeometryLabels:
    """``Columns`` from the reconstruction of a capture by a method, seen once from the left and once from the right.

    method, weights: as in ``ReconstructionOptions``. least_confidence: of points that are believed. largest_residual:
    rad that either phase of the pixel itself may differ from what the point's column predicts; a pixel that contradicts
    its point is one of another surface. Raises CalibrationError where no projector is calibrated.
    """

    method: Method = "wft"
    weights: str | None = None
    least_confidence: float = 0.5
    largest_residual: float = 0.9

    def __call__(self, capture: Capture, rig: Rig) -> dict[Side, npt.NDArray[np.float32]]:
        if rig.projector is None:
            raise CalibrationError(
                f"{capture.source}: ablation A4 needs a calibrated projector; take A3, or calibrate it"
            )
        swapped = replace(
            capture, images={"left": capture.images["right"], "right": capture.images["left"]}, rig=None, truth=None
        )
        return {"left": self._left(capture, rig), "right": self._left(swapped, rig.from_the_right)}

    def _left(self, capture: Capture, rig: Rig) -> npt.NDArray[np.float32]:
        assert rig.projector is not None
        options = ReconstructionOptions(self.method, "trinocular", weights=self.weights)
        shape = (rig.left.height, rig.left.width)
        try:
            points = reconstruct(capture, options, rig=rig).points
        except ReconstructionError:
            return np.full(shape, _UNKNOWN)
        return self._columns(points, rig, capture.plan.of_kind("composite")[0].periods)

    def _columns(self, points: PointMap, rig: Rig, periods: tuple[float, ...]) -> npt.NDArray[np.float32]:
        assert rig.projector is not None
        columns = np.full(points.shape, _UNKNOWN, np.float32)
        columns[points.mask == Reason.UNLIT] = _NO_LIGHT
        believed = points.valid & (points.confidence >= self.least_confidence)
        column = rig.projector.project(points.points[believed].astype(np.float64))[:, 0]
        seen = np.stack([points.phase_high[believed], points.phase_low[believed]])
        residual = np.angle(np.exp(1j * (2 * np.pi * column / np.array(periods)[:, None] - seen)))
        agreed = (np.abs(residual) < self.largest_residual).all(axis=0)
        columns[believed] = np.where(agreed, column, _UNKNOWN)
        return columns
