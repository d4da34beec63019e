"""What a reconstruction is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from models.capture import Truth
from models.geometry.rig import Rig
from models.metrics.pseudo_phase import TURN, pseudo_unwrap
from models.points import PointMap


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference values on the left sensor's grid (H, W).

    depth: float32 mm. column: projector column u in mirrors, floating, NaN where unknown. foreground: bool, the pixels
    to be compared where their depth is known.
    """

    depth: npt.NDArray[np.float32]
    column: npt.NDArray[np.floating]
    foreground: npt.NDArray[np.bool_]

    @classmethod
    def from_truth(cls, truth: Truth) -> Reference:
        """What the simulator knows: both cameras see the pixel and the projector lights it."""
        return cls(truth.depth, truth.projector_column, truth.foreground)

    @classmethod
    def from_points(cls, points: PointMap, rig: Rig, period: float) -> Reference:
        """A capture's own N-step and Gray reconstruction, the paper's reference on real scenes.

        The column is that of the phase, with the order told by the reconstructed point; NaN throughout where the rig
        has no projector. period: of the high carrier, in projector columns.
        """
        column = np.full(points.shape, np.nan)
        valid = points.valid
        if rig.projector is not None:
            _, phase = pseudo_unwrap(points.points[valid], points.phase_high[valid], rig.projector, period)
            column[valid] = phase * period / TURN
        return cls(points.depth, column, valid)

    def within(self, depth_range: tuple[float, float]) -> npt.NDArray[np.bool_]:
        """The GT-valid foreground, (H, W): pixels whose reference depth is known and within the range, mm."""
        near, far = depth_range
        known = np.isfinite(self.depth)
        depth = np.where(known, self.depth, 0)
        return np.asarray(self.foreground & known & (depth >= near) & (depth <= far))

    def limited_to(self, region: npt.NDArray[np.bool_]) -> Reference:
        """The same reference of which only the pixels of a region (H, W) are compared."""
        return replace(self, foreground=self.foreground & region)
