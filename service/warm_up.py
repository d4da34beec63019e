"""Loading and compiling what the first reconstruction would otherwise wait for."""

from __future__ import annotations

import logging
from functools import partial

import numpy as np

from models.capture import Capture
from models.errors import DuofringeError
from models.geometry.rig import SIDES, Rig
from models.patterns import FringeParameters, make_plan
from models.reconstruct import ReconstructionOptions, reconstruct
from models.refiner.errors import RefinerError
from service.context import Service

logger = logging.getLogger("duofringe.service")


def warm_up(service: Service) -> None:
    """Load the refiner's default weights, and reconstruct noise with the calibration in force, where there is one.

    Weights that do not serve are told in the log; the service works without them.
    """
    parameters = FringeParameters()
    options = [ReconstructionOptions(method="wft")]
    try:
        parameters = FringeParameters(periods=service.weights.get().record.periods)
        options.append(ReconstructionOptions(method="refiner"))
    except RefinerError as error:
        logger.warning("%s; reconstructing with wft by default", error)
    rig = service.orchestrator.devices.calibration_in_force
    if rig is None:
        return
    capture = _noise(rig, parameters)
    for each in options:
        try:
            service.compute.submit(partial(reconstruct, capture, each)).result()
        except DuofringeError as error:
            logger.debug("warm-up ended as it should, without a cloud: %s", error)


def _noise(rig: Rig, parameters: FringeParameters) -> Capture:
    image = np.random.default_rng(0).integers(0, 255, (rig.left.height, rig.left.width), dtype=np.uint8)
    plan = make_plan("composite", parameters)
    return Capture(plan, {side: {"composite": image} for side in SIDES}, rig, source="warm-up")
