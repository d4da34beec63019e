"""Firmware files of the controller: TI's program, with one's own images behind it.

TI does not allow its program to be passed on, so a file is built from one that the user has. Only the images are
replaced; the first 0x20000 bytes, the bootloader, are never touched.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.splash import HEADER_BYTES, FirmwareError, Pixels, decode_image, encode_image
from models.atomic import atomic_file, require_parent

BOOTLOADER_BYTES = 0x20000
BASE_ADDRESS = 0xF9000000
LARGEST_FILE = 0x1000000
"""First of the two flash chips. What lies on the second takes addresses that nobody has tried."""
TABLE_IMAGES = 256
_SIGNATURE = 0x01234567
_TABLE_BYTES = 464
_SPLASH_AT = 16 + 8 * 20
_BLOCK = struct.Struct("<III")
_MAGIC = (0x12345678, 0x87654321)
_PAIR = struct.Struct("<II")
_UNUSED = b"\xff"


@dataclass(frozen=True)
class FirmwareFile:
    """A firmware file taken apart. program: everything before the images. blobs: each image as it is stored."""

    program: bytes
    blobs: tuple[bytes, ...]

    @classmethod
    def parse(cls, data: bytes) -> FirmwareFile:
        """Raises FirmwareError for bytes that are no firmware of this controller, or a damaged one."""
        start = _splash_offset(data)
        if len(data) < start + _BLOCK.size:
            raise FirmwareError(f"the firmware ends at byte {len(data)}, before its images; take a whole file")
        *magic, count = _BLOCK.unpack_from(data, start)
        if tuple(magic) != _MAGIC or not 0 < count <= TABLE_IMAGES:
            raise FirmwareError("the firmware has no table of images where it says; take another file")
        if len(data) < start + _BLOCK.size + count * _PAIR.size:
            raise FirmwareError("the firmware ends within its table of images; take a whole file")
        blobs = []
        for index in range(count):
            address, size = _PAIR.unpack_from(data, start + _BLOCK.size + index * _PAIR.size)
            offset = address - BASE_ADDRESS
            if offset < start or size < HEADER_BYTES or offset + size > len(data):
                raise FirmwareError(f"image {index} of the firmware lies outside the file; take a whole file")
            blobs.append(data[offset : offset + size])
        return cls(data[:start], tuple(blobs))

    @classmethod
    def from_file(cls, path: Path) -> FirmwareFile:
        """Raises FirmwareError where the file cannot be read or is none."""
        try:
            if path.stat().st_size > 2 * LARGEST_FILE:
                raise FirmwareError(f"{path} is larger than the projector's flash; take another file")
            return cls.parse(path.read_bytes())
        except OSError as error:
            raise FirmwareError(f"firmware {path} cannot be read: {error.strerror or error}") from error

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
        start = len(self.program)
        address = BASE_ADDRESS + start + _BLOCK.size + TABLE_IMAGES * _PAIR.size
        table = _BLOCK.pack(*_MAGIC, len(blobs))
        for blob in blobs:
            table += _PAIR.pack(address, len(blob))
            address += len(blob)
        table = table.ljust(_BLOCK.size + TABLE_IMAGES * _PAIR.size, _UNUSED)
        built = self.program + table + b"".join(blobs)
        if len(built) > LARGEST_FILE:
            raise FirmwareError(
                f"the firmware would take {len(built)} bytes and {LARGEST_FILE} are safe; store fewer patterns, or "
                "none that vary along both axes"
            )
        return built


def _splash_offset(data: bytes) -> int:
    if len(data) < BOOTLOADER_BYTES + _TABLE_BYTES:
        raise FirmwareError(f"{len(data)} bytes are no firmware of a LightCrafter 4500")
    (signature,) = struct.unpack_from("<I", data, BOOTLOADER_BYTES)
    if signature != _SIGNATURE:
        raise FirmwareError("the file has no flash table at 0x20000; it is no firmware of a LightCrafter 4500")
    address, _ = _PAIR.unpack_from(data, BOOTLOADER_BYTES + _SPLASH_AT)
    offset: int = address - BASE_ADDRESS
    if not BOOTLOADER_BYTES + _TABLE_BYTES <= offset < len(data):
        raise FirmwareError("the firmware's flash table places its images outside the file; take a whole file")
    return offset


def build_firmware(base: Path, manifest: FlashManifest, output: Path) -> FirmwareFile:
    """Write TI's program with the images of a manifest; returns what was written, read back.

    Raises FirmwareError, also where what reads back is not what the manifest says.
    """
    require_parent(output)
    program = FirmwareFile.from_file(base)
    images = [manifest.render(index) for index in range(manifest.images)]
    built = program.with_images(images)
    made = FirmwareFile.parse(built)
    for index, image in enumerate(images):
        if made.image(index).tobytes() != image.tobytes():
            raise FirmwareError(f"image {index} does not read back from the firmware; it was not written")
    with atomic_file(output) as partial:
        partial.write_bytes(built)
    return made
