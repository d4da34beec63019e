"""Wrapped phases of both views, kept small: pictures are made of them when somebody looks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import torch

from models.export.npz import read_arrays
from models.geometry.rig import Side
from models.phase.fringe import FringePhase
from models.points import Reason

Carrier = Literal["high", "low"]
CARRIERS: tuple[Carrier, ...] = get_args(Carrier)
_LEVELS = 65_534
_UNUSABLE = 65_535
_STEP = np.float32(2 * np.pi / _LEVELS)


def write_phases(phases: Mapping[Side, FringePhase], path: Path) -> None:
    """Arrays ``<carrier>_<side>``, uint16 (H, W): 0..65534 over -pi..pi rad, 65535 where the phase must not be used."""
    arrays: dict[str, npt.NDArray[np.uint16]] = {}
    for side, phase in phases.items():
        levels = phase.wrapped.add_(torch.pi).mul_(_LEVELS / (2 * torch.pi)).add_(0.5).cpu().numpy().astype(np.uint16)
        levels[:, phase.mask.cpu().numpy() != Reason.VALID] = _UNUSABLE
        arrays |= {f"{carrier}_{side}": values for carrier, values in zip(CARRIERS, levels, strict=False)}
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the arrays for its flag


def read_phase(path: Path, carrier: Carrier, side: Side) -> npt.NDArray[np.float32]:
    """One wrapped phase, float32 (H, W), rad to 5e-5, NaN where it must not be used; raises ReconstructionError."""
    name = f"{carrier}_{side}"
    levels = read_arrays(path, [name])[name]
    wrapped = levels.astype(np.float32) * _STEP - np.float32(np.pi)
    wrapped[levels == _UNUSABLE] = np.nan
    return np.asarray(wrapped, np.float32)
