"""``duofringe reconstruct``: a capture becomes a cloud on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Calibration, DepthRange, Json, Matching, MethodName

EXAMPLE = "Example: duofringe reconstruct demo/capture --method refiner --depth-range 400 670 --output cloud.ply"


def register(app: typer.Typer) -> None:
    app.command("reconstruct", epilog=EXAMPLE)(command)


def command(
    capture: Annotated[Path, typer.Argument(metavar="CAPTURE", help="Capture folder.")],
    method: Annotated[MethodName, typer.Option(help="Phase method.")],
    output: Annotated[
        Path, typer.Option(metavar="FILE", help="Result by suffix: .npz .ply .pcd .xyz .tiff (depth) .glb")
    ],
    weights: Annotated[
        str | None,
        typer.Option(metavar="NAME|PATH", help="Of the refiner: a shipped name, or a folder. Default: sim."),
    ] = None,
    calibration: Calibration = None,
    matching: Matching = None,
    depth_range: DepthRange = None,
    json: Json = False,
) -> None:
    """Reconstruct a capture: points in mm, on the left camera's pixels."""
    if weights is not None and method != "refiner":
        raise typer.BadParameter(f"method {method} takes no weights; only refiner does", param_hint="--weights")
    # Loaded here, not above: torch alone takes over a second, and --help should not wait for it.
    from models.capture import read_capture
    from models.export import SUFFIXES, check_output, write_points
    from models.geometry.rig import Rig
    from models.reconstruct import ReconstructionOptions, kinds_needed, reconstruct
    from service.summary import summarise

    if output.suffix.lower() not in SUFFIXES:
        raise typer.BadParameter(f"suffix '{output.suffix}' is unknown; use one of {' '.join(SUFFIXES)}")
    check_output(output)
    loaded = read_capture(capture, kinds=kinds_needed(method), with_truth=False)
    rig = None if calibration is None else Rig.from_file(calibration, size=loaded.image_size)
    options = ReconstructionOptions(method=method, matching=matching, depth_range=depth_range, weights=weights)
    with console.progress("reconstruct") as report:
        reconstruction = reconstruct(loaded, options, rig=rig, progress=report)
        write_points(reconstruction.points, output)
    for warning in loaded.record.warnings:
        console.note(f"warning: {warning}")
    summary = summarise(reconstruction)
    console.result({"output": str(output), **summary.as_json()}, f"{output}: {summary}", as_json=json)
