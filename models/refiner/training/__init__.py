"""Training of the refiner: views prepared once, crops drawn by seed, a loop that can be stopped and gone on with."""

from models.refiner.training.configuration import Labels, TrainingConfiguration
from models.refiner.training.loop import Training, TrainingProgress, train

__all__ = ["Labels", "Training", "TrainingConfiguration", "TrainingProgress", "train"]
