"""``duofringe patterns``: the images that a projector is loaded with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Json, Plan, RasterChoice

LIST_EXAMPLE = "Example: duofringe patterns list --plan reference"
EXPORT_EXAMPLE = "Example: duofringe patterns export patterns --plan full --raster diamond"

Raster = Annotated[RasterChoice, typer.Option(help="Mirrors of the projector: the LightCrafter 4500's are a diamond.")]


def register(app: typer.Typer) -> None:
    group = typer.Typer(help="List and export the projected patterns.", no_args_is_help=True, rich_markup_mode=None)
    group.command("list", epilog=LIST_EXAMPLE)(list_command)
    group.command("export", epilog=EXPORT_EXAMPLE)(export_command)
    app.add_typer(group, name="patterns")


def list_command(plan: Plan = "full", json: Json = False) -> None:
    """List the patterns of a plan in the order of their exposures."""
    from models.patterns import make_plan
    from service.pattern_images import describe

    chosen = make_plan(plan)
    lines = [f"{index:3d}  {describe(pattern)}" for index, pattern in enumerate(chosen.patterns)]
    text = "\n".join([f"plan {plan}: {len(chosen)} exposures", *lines])
    console.result(chosen.model_dump(mode="json"), text, as_json=json)


def export_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="New folder for the images.")],
    plan: Plan = "full",
    raster: Raster = "diamond",
    json: Json = False,
) -> None:
    """Write each pattern of a plan as an 8-bit PNG of the projector's size, and manifest.json beside them."""
    from service.pattern_images import export_patterns

    manifest = export_patterns(folder, plan, raster)
    size = manifest["raster"]
    text = f"{folder}: {len(manifest['patterns'])} images of {size['columns']}x{size['rows']} mirrors, {size['kind']}"
    console.result({"output": str(folder), **manifest}, text, as_json=json)
