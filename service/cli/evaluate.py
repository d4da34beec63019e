"""``duofringe evaluate``: the paper's tables over a split."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli import console
from service.cli.options import MATCHINGS, METHODS, DepthRange, Json, Workers, names_from

EXAMPLE = "Example: duofringe evaluate simulated --split test --methods nstep,wft --matching stereo,trinocular"


def register(app: typer.Typer) -> None:
    app.command("evaluate", epilog=EXAMPLE)(command)


def command(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Dataset, folder of captures, or one capture.")],
    methods: Annotated[str, typer.Option(metavar="A,B", help=f"Methods, separated by commas: {' '.join(METHODS)}.")],
    split: Annotated[str, typer.Option(help="train, val, test, or all.")] = "test",
    matching: Annotated[
        str | None,
        typer.Option(metavar="A,B", help=f"{' '.join(MATCHINGS)}, or both. Default: as the calibration allows."),
    ] = None,
    depth_range: DepthRange = None,
    truth: Annotated[
        Literal["auto", "simulator", "reference"],
        typer.Option(help="Compare with truth/, or with each capture's own N-step and Gray reconstruction."),
    ] = "auto",
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write all figures, also of each sample, as JSON.")
    ] = None,
    workers: Workers = 1,
    json: Json = False,
) -> None:
    """Evaluate methods on every sample of a split and print the paper's two tables, with intervals over scenes."""
    chosen = names_from(methods, METHODS, "--methods")
    matchings = (None,) if matching is None else names_from(matching, MATCHINGS, "--matching")

    from models.atomic import require_parent, write_text_atomically
    from models.dataset import open_dataset
    from service.evaluation import evaluate
    from service.sample_evaluation import EvaluationOptions

    if output is not None:
        require_parent(output)
    options = EvaluationOptions(chosen, matchings, depth_range, truth)
    with console.progress("evaluate") as report:
        evaluation = evaluate(open_dataset(dataset), split, options, workers=workers, progress=report)
    for sample, row, reason in evaluation.failures:
        console.note(f"warning: {sample}, {row}: counted as no valid pixel: {reason}")
    data = evaluation.as_json()
    if output is not None:
        write_text_atomically(output, json_module.dumps(data, indent=2, allow_nan=False) + "\n")
    console.result(data, evaluation.text(), as_json=json)
