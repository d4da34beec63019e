"""``duofringe import``: a recorded foreign set becomes a capture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Json

EXAMPLE = "Example: duofringe import scans/head --manifest head.toml --output head-capture"


def register(app: typer.Typer) -> None:
    app.command("import", epilog=EXAMPLE)(command)


def command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where the images of the set lie.")],
    manifest: Annotated[Path, typer.Option(metavar="FILE", help="TOML description; see docs/foreign-captures.md.")],
    output: Annotated[Path, typer.Option(metavar="CAPTURE", help="New capture folder.")],
    json: Json = False,
) -> None:
    """Import a recorded foreign set: images, patterns and calibration, as its manifest describes them."""
    from models.atomic import require_parent
    from models.capture import write_capture
    from models.foreign import import_capture

    require_parent(output)
    capture = import_capture(folder, manifest)
    write_capture(capture, output)
    width, height = capture.image_size
    data = {
        "output": str(output),
        "views": list(capture.sides),
        "patterns": list(capture.plan.names),
        "image_size": [width, height],
        "bit_depth": capture.record.bit_depth,
        "calibrated": capture.rig is not None,
    }
    views = "two views" if len(capture.sides) == 2 else "one view"
    text = f"{output}: {views} of {len(capture.plan)} patterns, {width}x{height}, {capture.record.bit_depth} bit, "
    text += "with calibration" if capture.rig is not None else "without calibration"
    console.result(data, text, as_json=json)
