"""Flash images for the LightCrafter 4500: packed BMPs, as TI's GUI and ``projector firmware build`` take them."""

from __future__ import annotations

from pathlib import Path

from drivers.lightcrafter.bitmaps import read_bitmap, write_image
from drivers.lightcrafter.firmware import FirmwareFile
from drivers.lightcrafter.flash_table import COLUMNS, ROWS, TABLE_IMAGES
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.splash import FirmwareError, Pixels
from models.atomic import atomic_folder
from models.patterns import PatternPlan

MANIFEST = "manifest.json"


def export_flash_images(folder: Path, plan: PatternPlan) -> FlashManifest:
    """Write ``flash_00.bmp`` ... (24-bit, 912x1140) and ``manifest.json``, which ``rig.projector.manifest`` names.

    The folder must not exist yet; it appears complete or not at all. Raises DuofringeError otherwise.
    """
    manifest = FlashManifest.packed(plan)
    with atomic_folder(folder) as partial:
        for index in range(manifest.images):
            write_image(partial / _name(index), manifest.render(index))
        manifest.write(partial / MANIFEST)
    return manifest


def extract_flash_images(firmware: FirmwareFile, folder: Path) -> list[str]:
    """Write every image of a firmware as BMP into a new folder; returns the names. Raises FirmwareError if damaged."""
    names = [_name(index) for index in range(len(firmware.blobs))]
    with atomic_folder(folder) as partial:
        for index, name in enumerate(names):
            write_image(partial / name, firmware.image(index))
    return names


def read_flash_images(folder: Path) -> tuple[list[Pixels], FlashManifest | None]:
    """The BMPs of a folder in the order of their names, and its ``manifest.json``, None where it has none.

    Raises FirmwareError for an image of another size, and where an image does not show what the manifest says of it.
    """
    if not folder.is_dir():
        raise FirmwareError(f"images '{folder}' is not a folder")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".bmp")
    if not 0 < len(paths) <= TABLE_IMAGES:
        raise FirmwareError(f"{folder} holds {len(paths)} BMPs; a firmware takes 1 to {TABLE_IMAGES}")
    manifest = FlashManifest.from_file(folder / MANIFEST) if (folder / MANIFEST).exists() else None
    if manifest is not None and manifest.images != len(paths):
        raise FirmwareError(f"{folder} holds {len(paths)} BMPs and its {MANIFEST} tells of {manifest.images}")
    images = []
    for index, path in enumerate(paths):
        image = read_bitmap(path)
        rows, columns = image.shape[:2]
        if (columns, rows) != (COLUMNS, ROWS):
            raise FirmwareError(f"image {path} has {columns}x{rows} pixels; the mirrors are {COLUMNS}x{ROWS}")
        if manifest is not None and image.tobytes() != manifest.render(index).tobytes():
            raise FirmwareError(
                f"image {path} does not show what {folder / MANIFEST} says; export it again, or remove the manifest"
            )
        images.append(image)
    return images, manifest


def _name(index: int) -> str:
    return f"flash_{index:02d}.bmp"
