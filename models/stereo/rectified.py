"""Phases of both views on the rectified canvases, as arrays that compiled kernels take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import torch

from models.geometry.rectification import Rectification
from models.geometry.rig import Side
from models.phase.fringe import FringePhase
from models.points import Reason
from models.stereo.resample import resample

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RectifiedView:
    """One view on its canvas (h, w).

    phase: float32 (C, h, w) wrapped, rad. modulation: float32 (C, h, w). texture: float32 (h, w).
    misfit: float32 (h, w), see ``FringePhase``; zeros where the method tells none.
    usable: bool (h, w), every sensor pixel that contributes carries a phase.
    column: float32 (h, w), absolute projector column, NaN where unknown; None without Gray planes.
    """

    phase: Float32Array
    modulation: Float32Array
    texture: Float32Array
    misfit: Float32Array
    usable: npt.NDArray[np.bool_]
    column: Float32Array | None

    def phase_steps(self) -> Float32Array:
        """Wrapped differences (n,) of the high phase between all pairs of usable neighbours along the rows, rad."""
        steps = np.diff(self.phase[0], axis=1)
        steps = (steps + np.pi) % (2 * np.pi) - np.pi
        return np.asarray(steps[self.usable[:, 1:] & self.usable[:, :-1]], np.float32)

    @cached_property
    def direction(self) -> float:
        """1.0 where the projector's columns grow along the baseline, -1.0 where they fall: it may stand on its head."""
        steps = self.phase_steps()
        return -1.0 if steps.size and float(np.median(steps)) < 0 else 1.0

    def every(self, row_step: int) -> RectifiedView:
        """The same view with only every ``row_step``-th row."""
        return RectifiedView(
            np.ascontiguousarray(self.phase[:, ::row_step]),
            np.ascontiguousarray(self.modulation[:, ::row_step]),
            np.ascontiguousarray(self.texture[::row_step]),
            np.ascontiguousarray(self.misfit[::row_step]),
            np.ascontiguousarray(self.usable[::row_step]),
            None if self.column is None else np.ascontiguousarray(self.column[::row_step]),
        )


def rectify_phases(phases: Mapping[Side, FringePhase], rectification: Rectification) -> dict[Side, RectifiedView]:
    """Resample both views; complex fields are interpolated (cubic), so that no phase wrap is."""
    return {side: _rectify_view(phase, rectification.maps[side]) for side, phase in phases.items()}


def _rectify_view(view: FringePhase, sensor_map: Float32Array) -> RectifiedView:
    carriers = view.carriers.cpu().numpy()
    usable = (view.mask == int(Reason.VALID)).cpu().numpy()
    channels = [part for carrier in carriers for part in (carrier.real, carrier.imag)]
    misfit = torch.zeros_like(view.texture) if view.misfit is None else view.misfit.clamp(max=9.0)
    channels += [view.texture.cpu().numpy(), misfit.cpu().numpy()]
    if view.column is not None:
        column = view.column.cpu().numpy()
        usable = usable & np.isfinite(column)
        channels.append(np.nan_to_num(column, nan=0.0))
    resampled, inside = resample(
        np.stack(channels).astype(np.float32), usable, sensor_map, 0 if view.column is None else 1
    )
    fields = resampled[0 : 2 * len(carriers) : 2] + 1j * resampled[1 : 2 * len(carriers) : 2]
    return RectifiedView(
        phase=np.angle(fields).astype(np.float32),
        modulation=np.abs(fields).astype(np.float32),
        texture=resampled[2 * len(carriers)],
        misfit=np.maximum(resampled[2 * len(carriers) + 1], 0.0),
        usable=inside,
        column=None if view.column is None else resampled[-1],
    )
