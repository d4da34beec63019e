"""What is left of a job when its process is done: weights go to the service's own, working files go."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from models.atomic import atomic_folder
from models.refiner.training.loop import CHECKPOINTS_NAME
from models.refiner.weights import load_weights
from service.jobs.errors import WeightsTakenError
from service.jobs.requests import TrainingJobRequest
from service.jobs.work import WEIGHTS_NAME


def publish(job: Path, request: TrainingJobRequest, result: dict[str, Any], shelf: Path) -> None:
    """Put a training's weights where reconstructions find them by name; once more is no harm.

    shelf: the service's own folder of weights, created. Raises WeightsTakenError where others took the name meanwhile.
    """
    target = shelf / request.name
    if target.exists():
        if load_weights(target)[1].sha256 == result["weights"]["sha256"]:
            return
        raise WeightsTakenError(f"weights '{request.name}' exist already: others took the name meanwhile")
    shelf.mkdir(parents=True, exist_ok=True)
    with atomic_folder(target) as partial:
        for path in (job / WEIGHTS_NAME).iterdir():
            shutil.copyfile(path, partial / path.name)


def tidy(job: Path) -> None:
    """Remove what a finished training needs no longer; its logs stay."""
    shutil.rmtree(job / WEIGHTS_NAME, ignore_errors=True)
    shutil.rmtree(job / f"{WEIGHTS_NAME}.training" / CHECKPOINTS_NAME, ignore_errors=True)
