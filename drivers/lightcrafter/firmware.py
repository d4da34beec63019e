"""Firmware files of the controller: TI's program, with one's own images behind it.

TI does not allow its program to be passed on, so a file is built from one that the user has. Only the images are
replaced; the first 0x20000 bytes, the bootloader, are never touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.lightcrafter.flash_table import TABLE_IMAGES, FlashTable, StoredImage, find_images, image_table
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.splash import FirmwareError, Pixels, decode_image, encode_image
from models.atomic import atomic_file, require_parent

LARGEST_FILE = 0x1000000
"""First of the two flash chips. What lies on the second takes addresses that nobody has tried."""


@dataclass(frozen=True)
class FirmwareFile:
    """A firmware file taken apart. program: everything before the images. blobs: each image as it is stored."""

    program: bytes
    blobs: tuple[bytes, ...]
    table: FlashTable
    stored: tuple[StoredImage, ...]

    @classmethod
    def parse(cls, data: bytes) -> FirmwareFile:
        """Raises FirmwareError for bytes that are no firmware of this controller, or a damaged one."""
        table = FlashTable.parse(data)
        stored = find_images(data, table.splash_offset)
        blobs = tuple(data[image.offset : image.offset + image.size] for image in stored)
        return cls(data[: table.splash_offset], blobs, table, stored)

    @classmethod
    def from_file(cls, path: Path) -> FirmwareFile:
        """Raises FirmwareError where the file cannot be read or is none."""
        return cls.parse_of(path, read_firmware(path))

    @classmethod
    def parse_of(cls, path: Path, data: bytes) -> FirmwareFile:
        """As ``parse``, with the file's name in the error."""
        try:
            return cls.parse(data)
        except FirmwareError as error:
            raise FirmwareError(f"firmware {path}: {error}") from error

    def image(self, index: int) -> Pixels:
        """(rows, columns, 3) green, red, blue; FirmwareError if damaged."""
        return decode_image(self.blobs[index])

    def with_images(self, images: Sequence[Pixels]) -> bytes:
        """The file with these images (rows, columns, 3) of green, red, blue and no other.

        Raises FirmwareError where they are too many, or too much for the first flash chip.
        """
        if not 0 < len(images) <= TABLE_IMAGES:
            raise FirmwareError(f"a firmware takes 1 to {TABLE_IMAGES} images, not {len(images)}")
        blobs = [encode_image(image) for image in images]
        built = self.program + image_table(len(self.program), blobs) + b"".join(blobs)
        if len(built) > LARGEST_FILE:
            raise FirmwareError(
                f"the firmware would take {len(built)} bytes and {LARGEST_FILE} are safe; store fewer patterns, or "
                "none that vary along both axes"
            )
        return built


def read_firmware(path: Path) -> bytes:
    """The bytes of a file no larger than the flash; FirmwareError where it cannot be read."""
    try:
        if path.stat().st_size > 2 * LARGEST_FILE:
            raise FirmwareError(f"{path} is larger than the projector's flash; take another file")
        return path.read_bytes()
    except OSError as error:
        raise FirmwareError(f"firmware {path} cannot be read: {error.strerror or error}") from error


def write_firmware(base: Path, images: Sequence[Pixels], output: Path) -> FirmwareFile:
    """Write TI's program with images (rows, columns, 3) of green, red, blue; returns what was written, read back.

    Raises FirmwareError, also where an image does not read back as it was given.
    """
    require_parent(output)
    built = FirmwareFile.from_file(base).with_images(images)
    made = FirmwareFile.parse(built)
    for index, image in enumerate(images):
        if made.image(index).tobytes() != image.tobytes():
            raise FirmwareError(f"image {index} does not read back from the firmware; it was not written")
    with atomic_file(output) as partial:
        partial.write_bytes(built)
    return made


def build_firmware(base: Path, manifest: FlashManifest, output: Path) -> FirmwareFile:
    """As ``write_firmware``, with the images of a manifest; these take seconds, so files are looked at first."""
    require_parent(output)
    FirmwareFile.from_file(base)
    return write_firmware(base, [manifest.render(index) for index in range(manifest.images)], output)
