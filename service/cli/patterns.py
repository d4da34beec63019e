"""``duofringe patterns``: the images that a projector is loaded with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from service.cli import console
from service.cli.options import Json, Plan, RasterChoice
from service.cli.plan_options import Plans, plans_from

if TYPE_CHECKING:
    from models.patterns import PlanName

LIST_EXAMPLE = "Example: duofringe patterns list --plan reference"
EXPORT_EXAMPLE = "Example: duofringe patterns export patterns --plan full --plan calibration"

Raster = Annotated[RasterChoice, typer.Option(help="Mirrors of the projector: the LightCrafter 4500's are a diamond.")]
FormatChoice = Literal["bmp", "hdmi", "png"]
Format = Annotated[
    FormatChoice,
    typer.Option(
        "--format",
        help="bmp: packed images for the flash of a LightCrafter 4500. hdmi: frames for its video input. "
        "png: one 8-bit image a pattern.",
    ),
]


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
    plan: Plans = None,
    form: Format = "bmp",
    raster: Raster = "diamond",
    json: Json = False,
) -> None:
    """Write the patterns of plans as a projector takes them, and manifest.json, which says what each image holds."""
    names = plans_from(plan)
    if raster != "diamond" and form != "png":
        raise typer.BadParameter(
            f"'{raster}' goes with --format png; a LightCrafter 4500 is a diamond", param_hint="--raster"
        )
    manifest, text = _EXPORTS[form](folder, names, raster)
    console.result({"output": str(folder), **manifest}, f"{folder}: {text}", as_json=json)


def _export_flash(folder: Path, names: tuple[PlanName, ...], raster: RasterChoice) -> tuple[dict[str, Any], str]:
    from service.flash_images import export_flash_images
    from service.pattern_images import combined_plan

    manifest = export_flash_images(folder, combined_plan(names))
    count = len(manifest.patterns)
    return manifest.model_dump(mode="json"), f"{count} patterns in {manifest.images} flash images of 912x1140 mirrors"


def _export_frames(folder: Path, names: tuple[PlanName, ...], raster: RasterChoice) -> tuple[dict[str, Any], str]:
    from service.pattern_images import combined_plan
    from service.video_frames import export_frames

    plan = combined_plan(names)
    manifest = export_frames(folder, plan)
    text = f"{len(plan)} patterns in {len(manifest.frames)} frames of 912x1140 pixels at 60 Hz"
    return manifest.model_dump(mode="json"), text


def _export_each(folder: Path, names: tuple[PlanName, ...], raster: RasterChoice) -> tuple[dict[str, Any], str]:
    from service.pattern_images import export_patterns

    manifest = export_patterns(folder, names, raster)
    size = manifest["raster"]
    return manifest, f"{len(manifest['patterns'])} images of {size['columns']}x{size['rows']} mirrors, {size['kind']}"


_EXPORTS = {"bmp": _export_flash, "hdmi": _export_frames, "png": _export_each}
