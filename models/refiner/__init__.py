"""The learned refiner: a residual network on the phases of a single-shot method, its losses and its weights."""

from models.refiner.configuration import RefinerConfiguration
from models.refiner.errors import RefinerError
from models.refiner.fields import RefinedPhase, RefinerInput
from models.refiner.loss_configuration import ABLATIONS, LossConfiguration
from models.refiner.losses import Loss, Observation, lit_pixels, total_loss
from models.refiner.network import Refiner
from models.refiner.shipped import find_weights, shipped_names
from models.refiner.weights import Variant, WeightsRecord, load_weights, save_weights

__all__ = [
    "ABLATIONS",
    "Loss",
    "LossConfiguration",
    "Observation",
    "RefinedPhase",
    "Refiner",
    "RefinerConfiguration",
    "RefinerError",
    "RefinerInput",
    "Variant",
    "WeightsRecord",
    "find_weights",
    "lit_pixels",
    "load_weights",
    "save_weights",
    "shipped_names",
    "total_loss",
]
