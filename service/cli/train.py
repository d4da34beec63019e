"""``duofringe train``: weights of the refiner from captures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from service.cli import console
from service.cli.options import Json

EXAMPLE = "Example: duofringe train captures --adapt sim --output my-rig"


def register(app: typer.Typer) -> None:
    app.command("train", epilog=EXAMPLE)(command)


def command(
    datasets: Annotated[
        list[Path], typer.Argument(metavar="DATASET...", help="Datasets or folders of captures, one or several.")
    ],
    output: Annotated[
        Path, typer.Option(metavar="WEIGHTS", help="New folder for the weights; states and logs go beside it.")
    ],
    labels: Annotated[
        Literal["none", "truth"],
        typer.Option(help="none: the captures alone. truth: the simulator's phases, of simulated datasets only."),
    ] = "none",
    ablation: Annotated[
        Literal["A0", "A1", "A2", "A3", "A3-central", "A4"],
        typer.Option(help="Which label-free losses; A4 also uses what both views and the projector agree on."),
    ] = "A3",
    adapt: Annotated[
        str | None,
        typer.Option(metavar="WEIGHTS", help="Go on from shipped weights (by name) or a folder: to fit them to a rig."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed, data and machine give the same weights.")] = 0,
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="State to go on from: WEIGHTS.training, or one state in it. Repeat the rest."
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Optimiser steps. Default: 4000, with --adapt 800.")] = None,
    learning_rate: Annotated[
        float | None, typer.Option(min=1e-7, max=0.1, help="Peak. Default: 1e-3 with truth, else 3e-4.")
    ] = None,
    pixels: Annotated[int | None, typer.Option(min=256, help="Pixels a step, all crops together.")] = None,
    checkpoint_every: Annotated[int | None, typer.Option(min=1, help="Steps from one state to the next.")] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Training configuration; the options above go before it.")
    ] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda. With torchrun: one process a device.")] = "cpu",
    json: Json = False,
) -> None:
    """Train the refiner, without labels by default.

    Stopped at whatever moment, a training goes on with --resume to the very weights it would have had. On several
    devices: torchrun --nproc-per-node N --no-python duofringe train ...
    """
    from models.atomic import require_parent
    from models.dataset import open_dataset
    from service.training import TrainingRequest, start_training

    require_parent(output)
    given: dict[str, Any] = {
        "steps": steps,
        "learning_rate": learning_rate,
        "pixels": pixels,
        "checkpoint_every": checkpoint_every,
    }
    request = TrainingRequest.of(
        labels=labels,
        ablation=ablation,
        adapt=adapt,
        seed=seed,
        overrides={name: value for name, value in given.items() if value is not None},
        file=config,
    )
    opened = [open_dataset(path) for path in datasets]
    with console.progress("train") as report:
        training = start_training(request, opened, output, resume=resume, device=device, report=report)
    if training is None:  # another process of the same training writes and tells
        return
    data = {
        "output": str(output),
        "variant": training.record.variant,
        "sha256": training.record.sha256,
        "validation": training.validation,
        "log": str(training.folder),
    }
    figures = ", ".join(f"{name} {value:.4g}" for name, value in training.validation.items())
    text = f"{output}: {training.record.variant} weights, sha256 {training.record.sha256[:12]}"
    console.result(data, f"{text}\nvalidation: {figures}" if figures else text, as_json=json)
