"""Everything that decides a training's result besides its captures, as it is stored beside the weights."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from models.refiner.configuration import RefinerConfiguration
from models.refiner.loss_configuration import LossConfiguration

Labels = Literal["none", "truth", "geometry"]
"""What stands beside the captures: nothing, the simulator's projector columns, or columns of points that both views
and the projector agreed on (no exposure more, no label either)."""
CropSize = tuple[Annotated[int, Field(ge=16, le=4096)], Annotated[int, Field(ge=16, le=4096)]]


class TrainingConfiguration(BaseModel):
    """steps: of the optimiser. pixels: of one step, over all its crops (of one process where there are several).
    crops: (height, width) px that a step draws one of; full views among them teach the bottleneck its later length.
    learning_rate: peak, reached after ``warm_up`` steps, then a cosine to 0. gradient_limit: of the gradient's norm.
    precision: of the convolutions; losses are always float32. phasor: weight of ``phasor_loss`` where there are
    labels. label_free: weight of the label-free losses beside it. modulus: weight of the modulus under known phases.
    checkpoint_every, validate_every: steps. validation_views: how many views of the validation split are looked at.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    schema_: Literal["refiner-training/1"] = Field(default="refiner-training/1", alias="schema")
    labels: Labels = "none"
    ablation: str = "A3"
    losses: LossConfiguration = LossConfiguration()
    network: RefinerConfiguration = RefinerConfiguration()
    periods: tuple[float, float] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    steps: Annotated[int, Field(ge=1, le=10_000_000)] = 4000
    pixels: Annotated[int, Field(ge=256, le=1 << 26)] = 300_000
    crops: Annotated[tuple[CropSize, ...], Field(min_length=1, max_length=8)] = (
        (192, 192),
        (192, 192),
        (256, 320),
        (480, 640),
    )
    learning_rate: Annotated[float, Field(gt=0, le=0.1)] = 1e-3
    warm_up: Annotated[int, Field(ge=0)] = 200
    weight_decay: Annotated[float, Field(ge=0, le=1)] = 1e-4
    gradient_limit: Annotated[float, Field(gt=0)] = 1.0
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    phasor: Annotated[float, Field(ge=0)] = 1.0
    label_free: Annotated[float, Field(ge=0)] = 1.0
    modulus: Annotated[float, Field(ge=0)] = 1.0
    checkpoint_every: Annotated[int, Field(ge=1)] = 200
    validate_every: Annotated[int, Field(ge=1)] = 500
    validation_views: Annotated[int, Field(ge=0, le=1000)] = 8

    @model_validator(mode="after")
    def _something_to_learn(self) -> TrainingConfiguration:
        if self.labels == "none" and not self.label_free:
            raise ValueError("label_free: without labels these losses are all there is; give them a weight")
        return self

    def rate(self, step: int) -> float:
        """Learning rate of step 0 .. steps - 1."""
        if step < self.warm_up:
            return self.learning_rate * (step + 1) / self.warm_up
        done = (step - self.warm_up) / max(1, self.steps - self.warm_up)
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * min(done, 1.0)))
