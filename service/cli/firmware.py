"""``duofringe projector firmware``: what a firmware file of the projector holds, and a file with one's own images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli import console
from service.cli.options import Json
from service.cli.plan_options import Plans, plans_from

if TYPE_CHECKING:
    from drivers.lightcrafter.firmware import FirmwareFile
    from drivers.lightcrafter.firmware_record import FirmwareRecord
    from drivers.lightcrafter.manifest import FlashManifest
    from drivers.lightcrafter.splash import Pixels

INSPECT_EXAMPLE = "Example: duofringe projector firmware inspect flash.bin --images shown"
BUILD_EXAMPLE = (
    "Example: duofringe projector firmware build --base DLPR350PROM_v4.4.0.bin --plan full --output flash.bin"
)
_CODINGS = {0: "raw", 1: "runs", 4: "four lines"}


def register(app: typer.Typer) -> None:
    group = typer.Typer(help="Firmware files of the LightCrafter 4500.", no_args_is_help=True, rich_markup_mode=None)
    group.command("inspect", epilog=INSPECT_EXAMPLE)(inspect_command)
    group.command("build", epilog=BUILD_EXAMPLE)(build_command)
    app.add_typer(group, name="firmware")


def inspect_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Firmware of a LightCrafter 4500.")],
    images: Annotated[Path | None, typer.Option(metavar="DIR", help="New folder for the images, as BMPs.")] = None,
    json: Json = False,
) -> None:
    """Say what a firmware file holds; a damaged one is refused, as is one that differs from its record."""
    from drivers.lightcrafter.firmware import FirmwareFile, read_firmware
    from drivers.lightcrafter.firmware_record import digest, read_record

    data = read_firmware(file)
    firmware = FirmwareFile.parse_of(file, data)
    record = read_record(file, data)
    for index in range(len(firmware.blobs)):
        firmware.image(index)
    found: dict[str, Any] = {"file": str(file), "bytes": len(data), "sha256": digest(data)}
    found |= _described(firmware, record)
    if images is not None:
        from service.flash_images import extract_flash_images

        found["written"] = [str(images / name) for name in extract_flash_images(firmware, images)]
    console.result(found, _text(found), as_json=json)


def _described(firmware: FirmwareFile, record: FirmwareRecord | None) -> dict[str, Any]:
    return {
        "table_version": firmware.table.version,
        "parts": [{"name": p.name, "address": p.address, "size": p.size} for p in firmware.table.parts],
        "program_bytes": len(firmware.program),
        "clear_of_bootloader": firmware.table.keeps_clear,
        "images": [
            {
                "index": index,
                "offset": image.offset,
                "bytes": image.size,
                "columns": image.header.columns,
                "rows": image.header.rows,
                "coding": _CODINGS[image.header.coding],
                "patterns": _patterns_of(record, index),
            }
            for index, image in enumerate(firmware.stored)
        ],
        "verified": record is not None,
    }


def _patterns_of(record: FirmwareRecord | None, image: int) -> list[str]:
    if record is None or record.manifest is None:
        return []
    return [stored.pattern.name for stored in record.manifest.patterns if stored.image == image]


def _text(found: dict[str, Any]) -> str:
    lines = [
        f"{found['file']}: {found['bytes']} bytes, flash table version 0x{found['table_version']:X}",
        f"sha256 {found['sha256']}"
        + ("; that of its record" if found["verified"] else "; no record beside it, so changed pixels would not show"),
        "keeps clear of the bootloader (0x0 to 0x1FFFF)"
        if found["clear_of_bootloader"]
        else "REACHES INTO THE BOOTLOADER (0x0 to 0x1FFFF)",
    ]
    for part in found["parts"]:
        size = "size unknown" if part["size"] is None else f"{part['size']} bytes"
        lines.append(f"  {part['name']:<14}0x{part['address']:08X}  {size}")
    lines += [
        f"  image {image['index']:<3} at 0x{image['offset']:06X}  {image['columns']}x{image['rows']}  "
        f"{image['bytes']:>8} bytes, {image['coding']:<10}  {' '.join(image['patterns'])}".rstrip()
        for image in found["images"]
    ]
    return "\n".join(lines)


def build_command(
    base: Annotated[Path, typer.Option(metavar="FILE", help="Firmware from TI, which gives the program.")],
    output: Annotated[Path, typer.Option(metavar="FILE", help="New firmware file; its record goes beside it.")],
    manifest: Annotated[Path | None, typer.Option(metavar="FILE", help="What each image is to hold.")] = None,
    plan: Plans = None,
    images: Annotated[
        Path | None, typer.Option(metavar="DIR", help="BMPs in the order of their names, and manifest.json.")
    ] = None,
    json: Json = False,
) -> None:
    """Put images behind TI's program: those of a manifest, of plans, or of a folder."""
    if sum(source is not None for source in (manifest, plan or None, images)) != 1:
        raise typer.BadParameter("say one of --manifest, --plan and --images", param_hint="images")
    from drivers.lightcrafter.firmware import write_firmware
    from drivers.lightcrafter.firmware_record import FirmwareRecord, digest, record_path
    from models.errors import DuofringeError

    for path in (output, record_path(output)):
        if path.exists():
            raise DuofringeError(f"output '{path}' exists already; name another file or remove it")
    pixels, described = _images(manifest, plans_from(plan), images)
    built = write_firmware(base, pixels, output)
    data = output.read_bytes()
    record = FirmwareRecord(sha256=digest(data), bytes=len(data), images=len(built.blobs), manifest=described)
    beside = record.write(output)
    result = {"output": str(output), "record": str(beside), "bytes": len(data), "sha256": record.sha256}
    text = f"{output}: {len(built.blobs)} images, {len(data)} bytes; {beside} says what they hold"
    console.result({**result, "images": len(built.blobs)}, text, as_json=json)


def _images(
    manifest: Path | None, plans: tuple[Any, ...], folder: Path | None
) -> tuple[list[Pixels], FlashManifest | None]:
    from drivers.lightcrafter.manifest import FlashManifest
    from service.flash_images import read_flash_images
    from service.pattern_images import combined_plan

    if folder is not None:
        return read_flash_images(folder)
    if manifest is not None:
        described = FlashManifest.from_file(manifest)
    else:
        described = FlashManifest.packed(combined_plan(plans))
    return [described.render(index) for index in range(described.images)], described
