"""What a request for a job may say. Everything is named, nothing is a path."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from models.errors import ReconstructionError
from models.stereo.matcher import Matching
from service.sample_evaluation import EvaluationOptions, MethodChoice, TruthSource
from service.weights import NAME_PATTERN

DATASET_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"
"""Of datasets in a request: no separator, so that a name leads out of no folder."""
MOST_STEPS = 1_000_000
_MOST_CAPTURES = 2000
DatasetName = Annotated[str, Field(pattern=DATASET_PATTERN)]
WeightsName = Annotated[str, Field(pattern=NAME_PATTERN)]
Captures = Annotated[
    tuple[Annotated[str, Field(max_length=64)], ...],
    Field(min_length=1, max_length=_MOST_CAPTURES, description="Ids of captures of the library."),
]


class TrainingJobRequest(BaseModel):
    """Weights of the refiner to be made from captures; the settings are those of ``duofringe train``."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={"examples": [{"datasets": ["bench-2025"], "adapt": "sim", "name": "my-rig"}]},
    )

    name: WeightsName = Field(description="Of the new weights, by which reconstructions may ask for them.")
    datasets: tuple[DatasetName, ...] | None = Field(
        None, min_length=1, max_length=32, description="Folders of the service's datasets folder. Or `captures`."
    )
    captures: Captures | None = None
    labels: Literal["none", "truth"] = Field(
        "none", description="none: the captures alone. truth: the simulator's phases, of simulated datasets only."
    )
    ablation: Literal["A0", "A1", "A2", "A3", "A3-central", "A4"] = Field(
        "A3", description="Which label-free losses; A4 also uses what both views and the projector agree on."
    )
    adapt: WeightsName | None = Field(None, description="Weights to begin from, by name; by default none.")
    seed: int = Field(0, ge=0, lt=2**31)
    steps: int | None = Field(
        None, ge=1, le=MOST_STEPS, description="Of the optimiser; by default 4000, with `adapt` 800."
    )
    learning_rate: float | None = Field(
        None, ge=1e-7, le=0.1, description="Peak; by default 1e-3 with labels truth, else 3e-4."
    )
    pixels: int | None = Field(None, ge=256, le=1 << 26, description="Of one step, all its crops together.")
    checkpoint_every: int | None = Field(
        None, ge=1, le=MOST_STEPS, description="Steps from one state, from which a training can go on, to the next."
    )
    device: str = Field("cpu", pattern=r"^(cpu|cuda(:\d{1,2})?)$", description="Where it is trained.")

    @model_validator(mode="after")
    def _settings_go_together(self) -> TrainingJobRequest:
        if (self.datasets is None) == (self.captures is None):
            raise ValueError("datasets: name either datasets or captures")
        if self.labels == "truth" and self.ablation != "A3":
            raise ValueError("ablation: chooses among label-free losses; it does not go with labels truth")
        return self

    @property
    def overrides(self) -> dict[str, int | float]:
        """Fields of ``TrainingConfiguration`` that are given."""
        given = {name: getattr(self, name) for name in ("steps", "learning_rate", "pixels", "checkpoint_every")}
        return {name: value for name, value in given.items() if value is not None}


class EvaluationJobRequest(BaseModel):
    """Methods to be compared on a split; the settings are those of ``duofringe evaluate``."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={"examples": [{"dataset": "bench-2025", "methods": ["wft", "refiner:my-rig"]}]},
    )

    dataset: DatasetName | None = Field(None, description="Folder of the service's datasets folder. Or `captures`.")
    captures: Captures | None = None
    split: str = Field(
        "test", pattern=DATASET_PATTERN, description="train, val, test, or all; captures have no splits."
    )
    methods: tuple[Annotated[str, Field(max_length=100)], ...] = Field(
        min_length=1,
        max_length=16,
        description="METHOD, or METHOD:WEIGHTS where a method has learned.",
        examples=[["wft", "refiner", "refiner:my-rig"]],
    )
    matching: tuple[Matching, ...] | None = Field(
        None, min_length=1, max_length=2, description="By default as each capture's calibration allows."
    )
    depth_range: tuple[float, float] | None = Field(
        None, description="(min, max) mm; by default the calibration's working range.", examples=[[400, 670]]
    )
    truth: TruthSource = Field(
        "auto", description="simulator: truth/ of the captures. reference: each capture's own N-step and Gray."
    )
    against: str | None = Field(
        None, max_length=120, description="Row of the tables that the others are compared with.", examples=["wft"]
    )

    @field_validator("methods")
    @classmethod
    def _methods_exist(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        try:
            return tuple(dict.fromkeys(MethodChoice.parse(text).label for text in methods))
        except ReconstructionError as error:
            raise ValueError(str(error)) from error

    @model_validator(mode="after")
    def _settings_go_together(self) -> EvaluationJobRequest:
        if (self.dataset is None) == (self.captures is None):
            raise ValueError("dataset: name either a dataset or captures")
        if self.depth_range is not None and not 0 < self.depth_range[0] < self.depth_range[1] < 1e6:
            raise ValueError("depth_range: 0 < MIN < MAX < 1e6 mm")
        if self.against is not None and self.against not in self.options.rows:
            raise ValueError(f"against: there will be no such row; the rows are {', '.join(self.options.rows)}")
        return self

    @property
    def options(self) -> EvaluationOptions:
        """As ``evaluate`` takes them."""
        choices = tuple(MethodChoice.parse(text) for text in self.methods)
        matchings = (None,) if self.matching is None else tuple(dict.fromkeys(self.matching))
        return EvaluationOptions(choices, matchings, self.depth_range, self.truth)


JobRequest = TrainingJobRequest | EvaluationJobRequest
