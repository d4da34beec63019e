"""What a job does, in its own process: the same functions as the command line."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from models.atomic import write_text_atomically
from models.refiner import RefinerError
from models.refiner.training.checkpoint import read_checkpoint
from models.refiner.training.loop import CHECKPOINTS_NAME
from models.refiner.weights import load_weights
from service.evaluation import evaluate
from service.evaluation_report import report_text
from service.jobs.order import Order
from service.jobs.requests import EvaluationJobRequest, TrainingJobRequest
from service.training import TrainingRequest, start_training

WEIGHTS_NAME = "weights"
EVALUATION_NAME = "evaluation.json"
Report = Callable[[str, float], None]
"""Called with what is done, and the share of the stage that it belongs to."""


def run_training(order: Order, report: Report) -> dict[str, Any]:
    """Train into the job's folder, from the newest state in it if there is one; weights in it are left as they are."""
    asked = TrainingJobRequest.model_validate(order.request)
    output = order.folder / WEIGHTS_NAME
    if not output.exists():
        request = TrainingRequest.of(
            labels=asked.labels,
            ablation=asked.ablation,
            adapt=None if order.adapt is None else str(order.adapt),
            seed=asked.seed,
            overrides=asked.overrides,
        )
        state = newest_state(order.folder / f"{WEIGHTS_NAME}.training" / CHECKPOINTS_NAME)
        start_training(request, order.opened(), output, resume=state, device=asked.device, report=report)
    _, record = load_weights(output)
    named = {"name": asked.name, "variant": record.variant, "sha256": record.sha256}
    return {"weights": named, "validation": record.training.get("validation", {})}


def newest_state(folder: Path) -> Path | None:
    """The newest state of a training that can be read, None where there is none; what cannot is removed."""
    states = sorted(folder.glob("step-*"), reverse=True) if folder.is_dir() else []
    for state in states:
        try:
            read_checkpoint(state)
        except RefinerError:
            shutil.rmtree(state, ignore_errors=True)
        else:
            return state
    return None


def run_evaluation(order: Order, report: Report) -> dict[str, Any]:
    """Evaluate, and write all figures into the job's folder."""
    asked = EvaluationJobRequest.model_validate(order.request)
    (dataset,) = order.opened()
    if order.weights.is_dir():
        os.chdir(order.weights)  # where REFINER:NAME is a path as well, so that rows bear the name alone
    evaluation = evaluate(dataset, asked.split, asked.options, against=asked.against, progress=report)
    content = json.dumps(evaluation.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text_atomically(order.folder / EVALUATION_NAME, order.public(content) + "\n")
    failures = [order.public(f"{sample}, {row}: {reason}") for sample, row, reason in evaluation.failures]
    return {
        "samples": len(evaluation.samples),
        "tables": report_text(evaluation),
        "failed": len(failures),
        "failures": failures[:20],
    }
