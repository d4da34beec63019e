"""How well the refiner does on views that it does not train on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from models.refiner.fields import RefinedPhase, RefinerInput
from models.refiner.losses import Observation, lit_pixels, total_loss
from models.refiner.network import Refiner
from models.refiner.training.configuration import TrainingConfiguration
from models.refiner.training.crops import Crops, whole_view
from models.refiner.training.views import View

CLOSE_RAD = 0.35


def validate(
    refiner: Refiner, views: Sequence[View], configuration: TrainingConfiguration, device: torch.device
) -> dict[str, float]:
    """Figures over whole views: ``label_free``, the label-free losses' total of the refined phase and ``.._input`` of
    the phase it was given; where columns are known also, for each carrier, ``close``: per cent of the lit pixels
    within 0.35 rad, and ``median``: rad, both also for the input.
    """
    sums: dict[str, list[float]] = {}
    errors: dict[str, list[torch.Tensor]] = {}
    was_training = refiner.training
    refiner.eval()
    with torch.inference_mode():
        for view in views:
            crops = whole_view(view)
            observed = RefinerInput(crops.image.to(device), crops.carriers.to(device))
            refined = refiner(observed)
            given = RefinedPhase.of(observed.carriers)
            for suffix, phase in (("", refined), ("_input", given)):
                loss = total_loss(
                    phase, observation_of(crops, configuration, device), view.periods, configuration.losses
                )
                sums.setdefault(f"label_free{suffix}", []).append(float(loss.total))
                for name, error in _errors(phase.carriers.cpu(), crops).items():
                    errors.setdefault(f"{name}{suffix}", []).append(error)
    refiner.train(was_training)
    figures = {name: float(np.mean(values)) for name, values in sums.items()}
    for name, parts in errors.items():
        joined = torch.cat(parts)
        if len(joined):
            figures[f"close_{name}"] = 100 * float((joined < CLOSE_RAD).float().mean())
            figures[f"median_{name}"] = float(joined.median())
    return figures


def observation_of(crops: Crops, configuration: TrainingConfiguration, device: torch.device) -> Observation:
    """What the label-free losses judge a batch by."""
    lit = lit_pixels(crops.carriers, configuration.losses.noise_level)
    return Observation(crops.image.to(device), crops.texture.to(device), lit.to(device))


def _errors(carriers: torch.Tensor, crops: Crops) -> dict[str, torch.Tensor]:
    if crops.target is None:
        return {}
    known = (crops.target.abs() > 0.5) & (crops.carriers.abs() > 1e-3)
    error = torch.angle(carriers * crops.target.conj()).abs()
    return {name: error[:, i][known[:, i]] for i, name in enumerate(("high", "low"))}
