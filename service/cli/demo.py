"""``duofringe demo``: the whole way once, on a simulated rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Json

EXAMPLE = "Example: duofringe demo --output /tmp"
DEFAULT_FOLDER = Path("demo")


def register(app: typer.Typer) -> None:
    app.command("demo", epilog=EXAMPLE)(command)


def command(
    output: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Existing folder for the results. Default: demo, created here.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Another scene.")] = None,
    json: Json = False,
) -> None:
    """Simulate a capture, reconstruct it, compare it with the truth; write clouds and pictures.

    Where the recorded sets lie beside the repository (or at DUOFRINGE_DATA), a real scan is reconstructed as well.
    """
    from models.errors import DuofringeError
    from service.demonstration import DEFAULT_SEED, demonstrate

    if output is None:
        output = DEFAULT_FOLDER
        output.mkdir(exist_ok=True)
    elif not output.is_dir():
        raise DuofringeError(f"output folder '{output}' does not exist; create it first")
    with console.progress("demo") as report:
        demonstration = demonstrate(output, DEFAULT_SEED if seed is None else seed, report)
    text = f"{demonstration.text()}\n\nclouds, pictures and the capture are in {output}/; look at {output}/overview.png"
    console.result({"output": str(output), **demonstration.as_json()}, text, as_json=json)
