"""Evaluation of methods over a split: every method on every sample, in processes, summed up as the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models.dataset import Dataset
from models.metrics import Figures, Interval, aggregate, bootstrap, figures_as_json, table_text
from service.process_pool import map_in_processes
from service.sample_evaluation import EvaluationOptions, SampleResult, evaluate_sample

BOOTSTRAP_SEED = 20240


@dataclass(frozen=True)
class Evaluation:
    """Figures by row over all samples, their intervals over scenes, and every sample by itself."""

    samples: tuple[SampleResult, ...]
    figures: Mapping[str, Figures]
    intervals: Mapping[str, Mapping[str, Interval]]
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def failures(self) -> list[tuple[str, str, str]]:
        """(sample, row, reason) of each reconstruction that failed; its pixels count as invalid."""
        return [(s.sample, row, reason) for s in self.samples for row, reason in s.failures.items()]

    def mean_timings_s(self) -> dict[str, dict[str, float]]:
        """Mean seconds per stage of each row, over the samples that it reconstructed."""
        rows: dict[str, dict[str, float]] = {}
        for row in self.figures:
            stages = [s.timings_s[row] for s in self.samples if row in s.timings_s]
            names = dict.fromkeys(name for timing in stages for name in timing)
            rows[row] = {n: round(float(np.mean([timing.get(n, 0.0) for timing in stages])), 4) for n in names}
        return rows

    def text(self) -> str:
        """Both tables, and the mean seconds a sample takes."""
        timings = [
            f"{row}: {sum(stages.values()):.2f} s a sample ("
            + ", ".join(f"{name} {seconds:.2f}" for name, seconds in stages.items())
            + ")"
            for row, stages in self.mean_timings_s().items()
            if stages
        ]
        intervals = self.intervals if len(self.samples) > 1 else None
        return table_text(self.figures, intervals) + "\n" + "\n".join(timings)

    def as_json(self) -> dict[str, Any]:
        """JSON-ready: settings, rows, and per-sample figures, timings and failures."""
        timings = self.mean_timings_s()
        rows = {
            row: {**figures_as_json(figures, self.intervals[row]), "timings_s": timings[row]}
            for row, figures in self.figures.items()
        }
        return {
            "schema": "evaluation/1",
            **self.settings,
            "rows": rows,
            "samples": [_sample_json(s) for s in self.samples],
        }


def _sample_json(result: SampleResult) -> dict[str, Any]:
    return {
        "sample": result.sample,
        "object_id": result.object_id,
        "truth": result.truth,
        "rows": {row: figures_as_json(aggregate([errors])) for row, errors in result.errors.items()},
        "timings_s": {row: {n: round(s, 4) for n, s in stages.items()} for row, stages in result.timings_s.items()},
        "failures": dict(result.failures),
    }


def evaluate(
    dataset: Dataset,
    split: str,
    options: EvaluationOptions,
    *,
    workers: int = 1,
    progress: Callable[[str, float], None] | None = None,
) -> Evaluation:
    """Evaluate methods over a split of a dataset.

    Where a sample has N-step images, two rows are added that tell the matcher's share from the phase's: the N-step
    pair as wrapped phases through the same matcher, and with the order that its Gray planes tell. The common mask is
    that of the methods asked for. A reconstruction that fails counts as no valid pixel and is listed.
    progress: called with (sample, share done). Raises DuofringeError when a sample cannot be evaluated at all.
    """
    paths = dataset.capture_paths(split)
    job = partial(evaluate_sample, options=options, fallback_rig=dataset.rig)
    results: dict[Path, SampleResult] = {}
    for path, result in map_in_processes(job, paths, workers, name=lambda p: p.name):
        results[path] = result
        if progress is not None:
            progress(result.sample, len(results) / len(paths))
    samples = tuple(results[path] for path in paths)
    rows = dict.fromkeys(row for sample in samples for row in sample.errors)
    errors = {row: [s.errors[row] for s in samples if row in s.errors] for row in rows}
    settings = {
        "dataset": str(dataset.root),
        "split": split,
        "methods": list(options.methods),
        "depth_range_mm": options.depth_range,
    }
    return Evaluation(
        samples,
        {row: aggregate(own) for row, own in errors.items()},
        {row: bootstrap(own, BOOTSTRAP_SEED) for row, own in errors.items()},
        settings,
    )
