"""Evaluation of methods over a split: every method on every sample, in processes, summed up as the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models.dataset import Dataset
from models.errors import DatasetError
from models.metrics import (
    CLASS_TITLES,
    REGION_TITLES,
    Difference,
    Figures,
    Interval,
    SampleErrors,
    aggregate,
    bootstrap,
    classes_of,
    differences_as_json,
    figures_as_json,
    paired_bootstrap,
)
from service.process_pool import map_in_processes
from service.sample_evaluation import EvaluationOptions, SampleResult, evaluate_sample

BOOTSTRAP_SEED = 20240
PICTURED_SAMPLES = 4
TITLES: Mapping[str, str] = {**CLASS_TITLES, **REGION_TITLES}
"""What classes of scenes and regions are called in tables, in their order."""


@dataclass(frozen=True)
class Summary:
    """Figures by row over some samples, their intervals over scenes, and their differences to one of the rows."""

    figures: Mapping[str, Figures]
    intervals: Mapping[str, Mapping[str, Interval]]
    differences: Mapping[str, Mapping[str, Difference]] = field(default_factory=dict)

    @classmethod
    def of(cls, samples: Sequence[Mapping[str, SampleErrors]], against: str | None = None) -> Summary:
        """Sum up samples, each given as its errors by row. against: the row that differences are taken to.

        A row and the one it is compared with are taken over the samples that have both.
        """
        rows = dict.fromkeys(row for sample in samples for row in sample)
        errors = {row: [sample[row] for sample in samples if row in sample] for row in rows}
        differences = {}
        for row in rows:
            if against is None or row == against:
                continue
            both = [(sample[row], sample[against]) for sample in samples if row in sample and against in sample]
            if both:
                ours, theirs = zip(*both, strict=True)
                differences[row] = paired_bootstrap(ours, theirs, BOOTSTRAP_SEED)
        return cls(
            {row: aggregate(own) for row, own in errors.items()},
            {row: bootstrap(own, BOOTSTRAP_SEED) for row, own in errors.items()},
            differences,
        )

    def rows_as_json(self) -> dict[str, dict[str, Any]]:
        return {row: figures_as_json(figures, self.intervals[row]) for row, figures in self.figures.items()}

    def differences_as_json(self) -> dict[str, Any]:
        return {row: differences_as_json(told) for row, told in self.differences.items()}


@dataclass(frozen=True)
class Evaluation:
    """Every sample by itself; all of them summed up, and each class of scenes and region that has any pixels.

    against: the row that differences are taken to, if any.
    """

    samples: tuple[SampleResult, ...]
    whole: Summary
    classes: Mapping[str, Summary]
    settings: Mapping[str, Any] = field(default_factory=dict)
    against: str | None = None

    @property
    def failures(self) -> list[tuple[str, str, str]]:
        """(sample, row, reason) of each reconstruction that failed; its pixels count as invalid."""
        return [(s.sample, row, reason) for s in self.samples for row, reason in s.failures.items()]

    def mean_timings_s(self) -> dict[str, dict[str, float]]:
        """Mean seconds per stage of each row, over the samples that it reconstructed."""
        rows: dict[str, dict[str, float]] = {}
        for row in self.whole.figures:
            stages = [s.timings_s[row] for s in self.samples if row in s.timings_s]
            names = dict.fromkeys(name for timing in stages for name in timing)
            rows[row] = {n: round(float(np.mean([timing.get(n, 0.0) for timing in stages])), 4) for n in names}
        return rows

    def as_json(self) -> dict[str, Any]:
        """JSON-ready: settings, rows, classes, differences, and per-sample figures, timings and failures."""
        timings = self.mean_timings_s()
        data = {
            "schema": "evaluation/1",
            **self.settings,
            "rows": {row: {**told, "timings_s": timings[row]} for row, told in self.whole.rows_as_json().items()},
            "classes": {
                name: {"title": TITLES[name], "rows": summary.rows_as_json()} for name, summary in self.classes.items()
            },
            "samples": [_sample_json(s) for s in self.samples],
        }
        if self.against is not None:
            data["differences"] = {
                "against": self.against,
                "rows": self.whole.differences_as_json(),
                "classes": {name: summary.differences_as_json() for name, summary in self.classes.items()},
            }
        return data


def _sample_json(result: SampleResult) -> dict[str, Any]:
    def rows(errors: Mapping[str, SampleErrors]) -> dict[str, Any]:
        return {row: figures_as_json(aggregate([own])) for row, own in errors.items()}

    return {
        "sample": result.sample,
        "object_id": result.object_id,
        "truth": result.truth,
        "traits": None if result.traits is None else sorted(result.traits),
        "rows": rows(result.errors),
        "regions": {region: rows(errors) for region, errors in result.regions.items()},
        "timings_s": {row: {n: round(s, 4) for n, s in stages.items()} for row, stages in result.timings_s.items()},
        "failures": dict(result.failures),
    }


def evaluate(
    dataset: Dataset,
    split: str,
    options: EvaluationOptions,
    *,
    against: str | None = None,
    workers: int = 1,
    progress: Callable[[str, float], None] | None = None,
) -> Evaluation:
    """Evaluate methods over a split of a dataset.

    Where a sample has N-step images, two rows are added that tell the matcher's share from the phase's: the N-step
    pair as wrapped phases through the same matcher, and with the order that its Gray planes tell. The common mask is
    that of the methods asked for. A reconstruction that fails counts as no valid pixel and is listed.
    against: the row that differences of the others are taken to. progress: called with (sample, share done).
    With ``options.pictures`` and no names in ``options.pictured`` the first four samples are drawn. Raises
    DatasetError for names or a row that there are not, and DuofringeError when a sample cannot be evaluated at all.
    """
    if against is not None and against not in options.rows:
        raise DatasetError(f"there will be no row '{against}' to compare with; the rows are {', '.join(options.rows)}")
    paths = dataset.capture_paths(split)
    options = _with_pictured(options, [path.name for path in paths], split)
    job = partial(evaluate_sample, options=options, fallback_rig=dataset.rig)
    results: dict[Path, SampleResult] = {}
    for path, result in map_in_processes(job, paths, workers, name=lambda p: p.name):
        results[path] = result
        if progress is not None:
            progress(result.sample, len(results) / len(paths))
    samples = tuple(results[path] for path in paths)
    settings = {
        "dataset": str(dataset.root),
        "split": split,
        "methods": [choice.label for choice in options.methods],
        "depth_range_mm": options.depth_range,
    }
    whole = Summary.of([s.errors for s in samples], against)
    classes = {name: Summary.of(errors, against) for name, errors in by_class(samples).items()}
    return Evaluation(samples, whole, classes, settings, against)


def by_class(samples: Sequence[SampleResult]) -> dict[str, list[Mapping[str, SampleErrors]]]:
    """Errors by row of the samples of each class of scenes, and of each region; what has no pixels is left out."""
    found: dict[str, list[Mapping[str, SampleErrors]]] = {name: [] for name in TITLES}
    for sample in samples:
        if sample.traits is not None:
            for name in classes_of(sample.traits):
                found[name].append(sample.errors)
        for region, errors in sample.regions.items():
            if any(own.pixels for own in errors.values()):
                found[region].append(errors)
    return {name: errors for name, errors in found.items() if errors}


def _with_pictured(options: EvaluationOptions, names: Sequence[str], split: str) -> EvaluationOptions:
    unknown = sorted(options.pictured.difference(names))
    if unknown:
        raise DatasetError(f"split '{split}' has no sample '{unknown[0]}' to draw; its first is '{names[0]}'")
    if options.pictures is None or options.pictured:
        return options
    return replace(options, pictured=frozenset(names[:PICTURED_SAMPLES]))
