"""A simulated scene that is cheap enough to be exposed thousands of times, shared by the tests of the drivers."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from drivers.simulator.devices import SimulatedSource
from drivers.simulator.geometry import reference_rig
from drivers.simulator.rig import SimulatedRig
from models.geometry.device import Device

_SHRINK = 10


def _small(camera: Device) -> Device:
    """The same view on a tenth of the pixels along each side."""
    width, height = camera.size
    matrix = camera.matrix / _SHRINK
    matrix[2, 2] = 1.0
    return replace(camera, size=(width // _SHRINK, height // _SHRINK), matrix=np.asarray(matrix))


@lru_cache(maxsize=1)
def small_rig() -> SimulatedRig:
    """The reference rig with cameras of 64 x 48 pixels."""
    rig = reference_rig()
    return SimulatedRig(replace(rig, left=_small(rig.left), right=_small(rig.right)), threads=1)


@lru_cache(maxsize=1)
def small_source() -> SimulatedSource:
    """The first scene of a seed before the small rig; tests leave it in place."""
    return SimulatedSource(seed=1, rig=small_rig())
