"""``duofringe evaluate``: the paper's tables over a split."""

from __future__ import annotations

import json as json_module
import shlex
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
    methods: Annotated[
        str,
        typer.Option(
            metavar="A,B",
            help=f"Methods, separated by commas: {' '.join(METHODS)}. METHOD:WEIGHTS where a method has learned.",
        ),
    ],
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
    against: Annotated[
        str | None,
        typer.Option(metavar="ROW", help="Also tell how far each other row is from this one, with intervals."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write all figures, also of each sample, as JSON.")
    ] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE.md", help="Write the tables as Markdown.")] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Draw samples into this folder, one PNG each.")
    ] = None,
    picture_samples: Annotated[
        str | None, typer.Option(metavar="ID,ID", help="Which samples to draw. Default: the first four.")
    ] = None,
    workers: Workers = 1,
    json: Json = False,
) -> None:
    """Evaluate methods on every sample of a split and print the paper's two tables, with intervals over scenes.

    A third table tells the figures by class of scene and near depth edges.
    """
    matchings = (None,) if matching is None else names_from(matching, MATCHINGS, "--matching")
    if picture_samples is not None and pictures is None:
        raise typer.BadParameter("needs --pictures FOLDER to draw into", param_hint="--picture-samples")

    from models.atomic import require_parent, write_text_atomically
    from models.dataset import open_dataset
    from models.errors import DuofringeError, ReconstructionError
    from service.evaluation import evaluate
    from service.evaluation_report import report_markdown, report_text
    from service.sample_evaluation import EvaluationOptions, MethodChoice

    try:
        chosen = tuple(dict.fromkeys(MethodChoice.parse(item) for item in methods.split(",")))
    except ReconstructionError as error:
        raise typer.BadParameter(str(error), param_hint="--methods") from error
    pictured = frozenset(name.strip() for name in (picture_samples or "").split(",") if name.strip())
    options = EvaluationOptions(chosen, matchings, depth_range, truth, pictures, pictured)
    if against is not None and against not in options.rows:
        raise typer.BadParameter(f"'{against}' is not one of {', '.join(options.rows)}", param_hint="--against")
    for file in (output, markdown):
        if file is not None:
            require_parent(file)
    if pictures is not None and not pictures.is_dir():
        raise DuofringeError(f"picture folder '{pictures}' does not exist; create it first")
    with console.progress("evaluate") as report:
        evaluation = evaluate(open_dataset(dataset), split, options, against=against, workers=workers, progress=report)
    for sample, row, reason in evaluation.failures:
        console.note(f"warning: {sample}, {row}: counted as no valid pixel: {reason}")
    if against is not None and not evaluation.whole.differences:
        console.note(f"warning: no sample has '{against}' and another row; there are no differences to tell")
    data = evaluation.as_json()
    if output is not None:
        write_text_atomically(output, json_module.dumps(data, indent=2, allow_nan=False) + "\n")
    if markdown is not None:
        labels = [choice.label for choice in chosen]
        repeat = _again(dataset, labels, split, matching, depth_range, truth, against)
        write_text_atomically(markdown, report_markdown(evaluation, repeat))
    console.result(data, report_text(evaluation), as_json=json)


def _again(
    dataset: Path,
    methods: list[str],
    split: str,
    matching: str | None,
    depth_range: tuple[float, float] | None,
    truth: str,
    against: str | None,
) -> str:
    """The command line that gives the same figures again."""
    words = ["duofringe", "evaluate", str(dataset), "--split", split, "--methods", ",".join(methods)]
    if matching is not None:
        words += ["--matching", matching]
    if depth_range is not None:
        words += ["--depth-range", *(f"{bound:g}" for bound in depth_range)]
    if truth != "auto":
        words += ["--truth", truth]
    if against is not None:
        words += ["--against", against]
    return shlex.join(words)
