"""The training itself: steps, states, logs, and weights at the end."""

from __future__ import annotations

import csv
import os
import shutil
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from models.dataset import Dataset
from models.errors import DatasetError
from models.refiner.errors import RefinerError
from models.refiner.fields import RefinerInput
from models.refiner.losses import total_loss
from models.refiner.network import Refiner
from models.refiner.supervision import modulus_loss, phasor_loss
from models.refiner.training.checkpoint import canonical, read_checkpoint, restore, write_checkpoint
from models.refiner.training.configuration import TrainingConfiguration
from models.refiner.training.crops import Crops, draw_crops
from models.refiner.training.processes import Processes, training_processes
from models.refiner.training.validation import observation_of, validate
from models.refiner.training.views import Columns, View, prepare_views, truth_columns
from models.refiner.weights import Variant, WeightsRecord, load_weights, save_weights

CHECKPOINTS_NAME = "checkpoints"


@dataclass(frozen=True)
class TrainingProgress:
    """step: steps done of ``steps``. loss: of the last step. seconds: since the beginning, over all runs. remaining:
    seconds that it will take still, None before that can be told. validation: newest figures, by name.
    """

    stage: str
    step: int
    steps: int
    loss: float = float("nan")
    seconds: float = 0.0
    remaining: float | None = None
    validation: dict[str, float] | None = None


@dataclass(frozen=True)
class Training:
    """record: of the weights written. validation: figures at the end. folder: of logs, beside the weights."""

    record: WeightsRecord
    validation: dict[str, float]
    folder: Path


Report = Callable[[TrainingProgress], None]


def train(
    datasets: Sequence[Dataset],
    configuration: TrainingConfiguration,
    output: Path,
    *,
    adapt: Path | None = None,
    resume: Path | None = None,
    columns: Columns | None = None,
    device: str = "cpu",
    report: Report | None = None,
) -> Training | None:
    """Train on the "train" splits, look at the "val" splits, write weights to the new folder ``output``.

    States and logs go to ``output`` + ".training" beside it, every ``checkpoint_every`` steps; a training that was
    stopped at whatever moment goes on from ``resume`` to the very weights it would have had. adapt: weights to begin
    from; their network is taken. columns: labels for configuration.labels "geometry". Of several processes
    (``torchrun``) the first one writes, and the others return None.
    Raises RefinerError, DatasetError or CaptureError telling what cannot be trained on.
    """
    if output.exists():
        raise RefinerError(f"output '{output}' exists already; name a new folder or remove it")
    work = output.with_name(f"{output.name}.training")
    if resume is None and any((work / CHECKPOINTS_NAME).glob("*")):
        raise RefinerError(f"'{work}' holds states of an earlier training; go on with --resume {work}, or remove it")
    with training_processes(device) as processes:
        return _Run(datasets, configuration, output, work, processes, report or (lambda progress: None)).run(
            adapt, resume, columns
        )


class _Run:
    def __init__(
        self,
        datasets: Sequence[Dataset],
        configuration: TrainingConfiguration,
        output: Path,
        work: Path,
        processes: Processes,
        report: Report,
    ) -> None:
        self.datasets = datasets
        self.configuration = configuration
        self.output = output
        self.work = work
        self.processes = processes
        self.report = report if processes.leads else (lambda progress: None)
        self.parent: str | None = None
        self.parent_variant: Variant | None = None

    def run(self, adapt: Path | None, resume: Path | None, columns: Columns | None) -> Training | None:
        state = None if resume is None else read_checkpoint(resume)
        start: Refiner | None = None
        if adapt is not None:
            start, known = load_weights(adapt)
            self.parent, self.parent_variant = known.sha256, known.variant
            self.configuration = self.configuration.model_copy(update={"network": start.configuration})
        if state is None and self.processes.leads:
            shutil.rmtree(self.work, ignore_errors=True)
        train_views, validation_views = self._views(columns)
        self.configuration = self.configuration.model_copy(update={"periods": train_views[0].periods})
        refiner = start or Refiner(self.configuration.network, self.configuration.seed)
        refiner.to(self.processes.device).train()
        optimiser = torch.optim.AdamW(
            refiner.parameters(), lr=self.configuration.learning_rate, weight_decay=self.configuration.weight_decay
        )
        done, seconds = 0, 0.0
        self.data = canonical([[view.name, view.sha256] for view in train_views])
        if state is not None:
            record = state.record
            if record.configuration != self.configuration or record.data != self.data or record.parent != self.parent:
                raise RefinerError(
                    f"{resume}: is of a training with other settings, captures or first weights; "
                    "repeat the command that began it, with --resume"
                )
            restore(state, refiner, optimiser)
            done, seconds = record.step, record.seconds
        figures, seconds = self._steps(refiner, optimiser, train_views, validation_views, done, seconds)
        if not self.processes.leads:
            return None
        record_of_weights = self._save(refiner, train_views, figures, seconds)
        shutil.rmtree(self.work / "views", ignore_errors=True)
        shutil.rmtree(self.work / "validation", ignore_errors=True)
        return Training(record_of_weights, figures, self.work)

    def _views(self, columns: Columns | None) -> tuple[list[View], list[View]]:
        wanted = self.configuration.labels
        labels = truth_columns if wanted == "truth" else columns
        if (wanted == "none") != (labels is None):
            raise RefinerError(f"labels '{wanted}' and the columns given do not go together")
        if self.processes.leads:
            self.work.mkdir(exist_ok=True)
            self._prepare("train", labels, wanted)
            self._prepare("val", truth_columns, "truth")
        self.processes.wait()
        views = self._prepare("train", labels, wanted)
        if len({view.periods for view in views}) > 1:
            raise RefinerError("the captures have fringes of different periods; train on captures of one pair")
        return views, self._prepare("val", truth_columns, "truth")

    def _prepare(self, split: str, columns: Columns | None, source: str) -> list[View]:
        views: list[View] = []
        for number, dataset in enumerate(self.datasets):
            labels = columns
            if split == "val":
                if dataset.splits is None or not dataset.splits.get("val") or not self.configuration.validation_views:
                    continue
                share = -(-self.configuration.validation_views // (2 * len(self.datasets)))
                captures = dataset.capture_paths("val")[:share]
                if not all((path / "truth").is_dir() for path in captures):
                    labels = None
            else:
                captures = dataset.capture_paths("train")
            if not captures:
                raise DatasetError(f"dataset '{dataset.root}' has nothing to train on")

            def told(done: int, count: int) -> None:
                self.report(TrainingProgress(f"preparing {split}", done, count))

            folder = self.work / ("views" if split == "train" else "validation") / f"{number}"
            views.extend(
                prepare_views(
                    captures,
                    folder,
                    fallback_rig=dataset.rig,
                    columns=labels,
                    source="none" if labels is None else source,
                    progress=told,
                )
            )
        return views

    def _steps(
        self,
        refiner: Refiner,
        optimiser: torch.optim.AdamW,
        views: list[View],
        validation_views: list[View],
        done: int,
        seconds: float,
    ) -> tuple[dict[str, float], float]:
        chosen, device = self.configuration, self.processes.device
        network = self.processes.joined(refiner)
        log = _Log(self.work / "log.csv", done) if self.processes.leads else None
        validations = _Log(self.work / "validation.csv", done) if self.processes.leads else None
        figures: dict[str, float] = {}
        begun = time.monotonic()
        with ThreadPoolExecutor(1) as ahead:
            upcoming = ahead.submit(draw_crops, views, chosen, done, self.processes.rank)
            for step in range(done, chosen.steps):
                crops = upcoming.result()
                upcoming = ahead.submit(draw_crops, views, chosen, step + 1, self.processes.rank)
                for group in optimiser.param_groups:
                    group["lr"] = chosen.rate(step)
                optimiser.zero_grad(set_to_none=True)
                with torch.autocast(device.type, torch.bfloat16, enabled=chosen.precision == "bfloat16"):
                    refined = network(RefinerInput(crops.image.to(device), crops.carriers.to(device)))
                total, terms = _loss(refined, crops, chosen, device)
                total.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(refiner.parameters(), chosen.gradient_limit)
                optimiser.step()
                loss = float(total.detach())
                if loss != loss:
                    raise RefinerError(f"step {step}: the loss is not a number; lower the learning rate")
                if not self.processes.leads:
                    continue
                assert log is not None
                assert validations is not None
                spent = seconds + time.monotonic() - begun
                log.add(step, {"rate": chosen.rate(step), "loss": loss, **terms, "seconds": spent})
                last = step + 1 == chosen.steps
                if validation_views and (last or (step + 1) % chosen.validate_every == 0):
                    figures = validate(refiner, validation_views, chosen, device)
                    validations.add(step + 1, figures)
                if not last and (step + 1) % chosen.checkpoint_every == 0:
                    write_checkpoint(
                        self.work / CHECKPOINTS_NAME,
                        refiner,
                        optimiser,
                        chosen,
                        step=step + 1,
                        seconds=spent,
                        data=self.data,
                        parent=self.parent,
                    )
                rate = (time.monotonic() - begun) / (step + 1 - done)
                self.report(
                    TrainingProgress(
                        "training", step + 1, chosen.steps, loss, spent, rate * (chosen.steps - step - 1), figures
                    )
                )
        return figures, seconds + time.monotonic() - begun

    def _save(self, refiner: Refiner, views: list[View], figures: dict[str, float], seconds: float) -> WeightsRecord:
        chosen = self.configuration
        variant: Variant = "sim" if chosen.labels == "truth" else "label-free"
        if self.parent_variant in ("sim", "sim+adapt") and chosen.labels != "truth":
            variant = "sim+adapt"
        assert chosen.periods is not None
        training: dict[str, Any] = {
            "configuration": chosen.model_dump(mode="json", by_alias=True),
            "datasets": [dataset.root.name for dataset in self.datasets],
            "views": len(views),
            "data_sha256": self.data,
            "parent_sha256": self.parent,
            "processes": self.processes.count,
            "threads": torch.get_num_threads(),
            "processors": os.cpu_count(),
            "torch": str(torch.__version__),
            "seconds": round(seconds, 1),
            "validation": {name: round(value, 5) for name, value in figures.items()},
        }
        certain = chosen.labels != "none" and chosen.phasor > 0
        return save_weights(self.output, refiner.eval(), chosen.periods, variant, training, foretells_certainty=certain)


def _loss(
    refined: Any, crops: Crops, configuration: TrainingConfiguration, device: torch.device
) -> tuple[torch.Tensor, dict[str, float]]:
    """The weighted total, and each of its terms for the log."""
    parts: list[torch.Tensor] = []
    terms: dict[str, float] = {}
    if crops.target is not None and crops.known is not None:
        target, known = crops.target.to(device), crops.known.to(device)
        phasor = phasor_loss(refined, target, known)
        modulus = modulus_loss(refined, target, known, crops.image.to(device), crops.texture.to(device))
        parts += [configuration.phasor * phasor, configuration.modulus * modulus]
        terms |= {"phasor": float(phasor.detach()), "modulus": float(modulus.detach())}
    if configuration.label_free:
        assert configuration.periods is not None
        observation = observation_of(crops, configuration, device)
        loss = total_loss(refined, observation, configuration.periods, configuration.losses)
        parts.append(configuration.label_free * loss.total)
        terms |= {name: float(value.detach()) for name, value in loss.terms.items()}
    return torch.stack(parts).sum(), terms


class _Log:
    """A CSV file that loses nothing but what a stopped run had written after its last state."""

    def __init__(self, path: Path, done: int) -> None:
        self.path = path
        if path.is_file():
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            kept = [
                line for line in lines[1:] if line.partition(",")[0].isdigit() and int(line.partition(",")[0]) < done
            ]
            path.write_text("".join(lines[:1] + kept), encoding="utf-8")

    def add(self, step: int, values: dict[str, float]) -> None:
        fresh = not self.path.is_file() or self.path.stat().st_size == 0
        with self.path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if fresh:
                writer.writerow(["step", *values])
            writer.writerow([step, *(f"{value:.6g}" for value in values.values())])
