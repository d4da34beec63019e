"""What starts a training, from the command line or as a job of the service."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from models.dataset import Dataset
from models.errors import DuofringeError
from models.geometry_labels import GeometryLabels
from models.refiner import ABLATIONS, RefinerError, find_weights
from models.refiner.training import Labels, Training, TrainingConfiguration, TrainingProgress, train

WITH_GEOMETRY = "A4"
_ADAPTING_STEPS = 800
_LABEL_FREE_RATE = 3e-4


@dataclass(frozen=True)
class TrainingRequest:
    """configuration: all settings. adapt: folder of the weights to begin from, None to begin anew."""

    configuration: TrainingConfiguration
    adapt: Path | None = None

    @classmethod
    def of(
        cls,
        *,
        labels: str = "none",
        ablation: str = "A3",
        adapt: str | None = None,
        seed: int = 0,
        overrides: Mapping[str, Any] | None = None,
        file: Path | None = None,
    ) -> TrainingRequest:
        """labels: "none" or "truth". ablation: A0 .. A3, A3-central, or A4 for A3 with geometric consistency. adapt:
        name of shipped weights or path. overrides: fields of ``TrainingConfiguration``, before those in ``file``, JSON.

        Raises RefinerError for settings that do not go together and DuofringeError for a file that is none.
        """
        if labels == "truth" and ablation != "A3":
            raise RefinerError("--ablation chooses among label-free losses; it does not go with --labels truth")
        kind: Labels = "truth" if labels == "truth" else "geometry" if ablation == WITH_GEOMETRY else "none"
        settings: dict[str, Any] = {"losses": ABLATIONS["A3" if ablation == WITH_GEOMETRY else ablation]}
        if kind == "truth":
            settings["label_free"] = 0.0
        else:
            settings["learning_rate"] = _LABEL_FREE_RATE
        if adapt is not None:
            settings["steps"] = _ADAPTING_STEPS
        settings |= _read(file) if file is not None else {}
        settings |= {"labels": kind, "ablation": ablation if kind != "truth" else "none", "seed": seed}
        settings |= overrides or {}
        try:
            configuration = TrainingConfiguration.model_validate(settings)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "training"
            raise RefinerError(f"{where}: {first['msg']}") from error
        return cls(configuration, None if adapt is None else find_weights(adapt))


def start_training(
    request: TrainingRequest,
    datasets: Sequence[Dataset],
    output: Path,
    *,
    resume: Path | None = None,
    device: str = "cpu",
    report: Callable[[str, float], None] | None = None,
) -> Training | None:
    """Run a training to its end; see ``models.refiner.training.train``. report: called with (what is done, share)."""

    def told(progress: TrainingProgress) -> None:
        if report is not None:
            report(_line(progress), progress.step / max(1, progress.steps))

    columns = None
    if request.configuration.labels == "geometry":
        columns = GeometryLabels("wft") if request.adapt is None else GeometryLabels("refiner", str(request.adapt))
    return train(
        datasets,
        request.configuration,
        output,
        adapt=request.adapt,
        resume=resume,
        columns=columns,
        device=device,
        report=told,
    )


def _read(file: Path) -> dict[str, Any]:
    try:
        return TrainingConfiguration.model_validate_json(file.read_text(encoding="utf-8")).model_dump(
            exclude_unset=True
        )
    except OSError as error:
        raise DuofringeError(f"{file}: not readable ({error.strerror})") from error
    except (UnicodeDecodeError, ValidationError) as error:
        told = error.errors()[0]["msg"] if isinstance(error, ValidationError) else "is not UTF-8"
        raise DuofringeError(f"{file}: {told}") from error


def _line(progress: TrainingProgress) -> str:
    if progress.stage != "training":
        return f"{progress.stage} {progress.step} of {progress.steps}"
    left = "" if progress.remaining is None else f", {_duration(progress.remaining)} left"
    return f"step {progress.step} of {progress.steps}, loss {progress.loss:.4f}{left}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
