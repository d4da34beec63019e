"""Loading and compiling what the first reconstruction would otherwise wait for."""

from __future__ import annotations

import logging

import numpy as np

from models.capture import Capture
from models.errors import DuofringeError
from models.geometry.rig import SIDES
from models.patterns import make_plan
from models.reconstruct import ReconstructionOptions, reconstruct
from service.context import Service

logger = logging.getLogger("duofringe.service")


def warm_up(service: Service) -> None:
    """Reconstruct a frame of noise with the calibration in force; without one there is nothing to warm."""
    rig = service.orchestrator.devices.calibration_in_force
    if rig is None:
        return
    noise = np.random.default_rng(0).integers(0, 255, (rig.left.height, rig.left.width), dtype=np.uint8)
    capture = Capture(make_plan("composite"), {side: {"composite": noise} for side in SIDES}, rig, source="warm-up")
    try:
        service.compute.submit(lambda: reconstruct(capture, ReconstructionOptions())).result()
    except DuofringeError as error:
        logger.debug("warm-up ended as it should, without a cloud: %s", error)
