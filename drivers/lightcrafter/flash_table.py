"""The two tables of a firmware file: which part of the program lies where, and where the images are.

Byte 0 of the file stands at flash address 0xF9000000. Every check here is of a place or a number that would have to be
wrong; the file has no checksum, so a changed byte of the program or of a pixel cannot be seen in it.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.lightcrafter.splash import FirmwareError, ImageHeader, header_of

BOOTLOADER_BYTES = 0x20000
BASE_ADDRESS = 0xF9000000
TABLE_IMAGES = 256
COLUMNS, ROWS = 912, 1140
TABLE_BYTES = 464
UNUSED = 0xFFFFFFFF
SIGNATURE = (0x01234567).to_bytes(4, "little")
"""First bytes of the flash table."""
_TABLE_HEAD = struct.Struct("<4s3I")
_PARTS = (
    ("AppCode", 4),
    ("ASIC", 4),
    ("Sequence", 4),
    ("ApplConfig", 4),
    ("OSD", 4),
    ("Splash", 4),
    ("Other", 4),
    ("Splash2", 12),
    ("Batch", 16),
)
_OF_THE_PROGRAM = ("AppCode", "ASIC", "Sequence", "ApplConfig", "OSD")
_BLOCK = struct.Struct("<III")
_MAGIC = (0x12345678, 0x87654321)
_PAIR = struct.Struct("<II")


@dataclass(frozen=True)
class Part:
    """One entry of the flash table that is used. size: None where the file does not tell."""

    name: str
    address: int
    size: int | None

    @property
    def offset(self) -> int:
        """In the file."""
        return self.address - BASE_ADDRESS


@dataclass(frozen=True)
class FlashTable:
    """The flash table at 0x20000."""

    version: int
    free_start: int
    parts: tuple[Part, ...]

    @classmethod
    def parse(cls, data: bytes) -> FlashTable:
        """Raises FirmwareError for bytes that are no firmware of this controller, and for a damaged table."""
        if len(data) < BOOTLOADER_BYTES + TABLE_BYTES:
            raise FirmwareError(f"{len(data)} bytes are no firmware of a LightCrafter 4500")
        signature, boot, version, free = _TABLE_HEAD.unpack_from(data, BOOTLOADER_BYTES)
        if signature != SIGNATURE:
            raise FirmwareError("the file has no flash table at 0x20000; it is no firmware of a LightCrafter 4500")
        if boot != BASE_ADDRESS:
            raise FirmwareError(f"the firmware's flash table begins at 0x{boot:08X}; it is damaged or of another board")
        table = cls(version, free, tuple(_parts(data)))
        table._check(len(data))
        return table

    @property
    def splash_offset(self) -> int:
        """Where the images begin in the file."""
        return next(part.offset for part in self.parts if part.name == "Splash[0]")

    @property
    def keeps_clear(self) -> bool:
        """Whether nothing that the table names lies in the bootloader."""
        return all(part.offset >= BOOTLOADER_BYTES for part in self.parts)

    def _check(self, size: int) -> None:
        if not any(part.name == "Splash[0]" for part in self.parts):
            raise FirmwareError("the firmware's flash table names no images; take another file")
        start = self.splash_offset
        if not BOOTLOADER_BYTES + TABLE_BYTES <= start < size:
            raise FirmwareError("the firmware's flash table places its images outside the file; take a whole file")
        for part in self.parts:
            if part.name.split("[")[0] not in _OF_THE_PROGRAM:
                continue
            if not BOOTLOADER_BYTES <= part.offset < start or part.offset + (part.size or 0) > size:
                raise FirmwareError(
                    f"the firmware's flash table places {part.name} at 0x{part.address:08X}, where no program can be; "
                    "take a whole file"
                )


def _parts(data: bytes) -> Iterator[Part]:
    at = BOOTLOADER_BYTES + _TABLE_HEAD.size
    for name, count in _PARTS:
        for index in range(count):
            address, size = _PAIR.unpack_from(data, at)
            at += _PAIR.size
            if address != UNUSED:
                yield Part(f"{name}[{index}]", address, None if size == UNUSED else size)


@dataclass(frozen=True)
class StoredImage:
    """One image of the file. offset, size: of header and pixels, bytes."""

    offset: int
    size: int
    header: ImageHeader


def find_images(data: bytes, start: int) -> tuple[StoredImage, ...]:
    """The images behind the table at ``start``; FirmwareError where the table or a header cannot be true."""
    if len(data) < start + _BLOCK.size:
        raise FirmwareError(f"the firmware ends at byte {len(data)}, before its images; take a whole file")
    *magic, count = _BLOCK.unpack_from(data, start)
    if tuple(magic) != _MAGIC or not 0 < count <= TABLE_IMAGES:
        raise FirmwareError("the firmware has no table of images where it says; take another file")
    first = start + _BLOCK.size
    if len(data) < first + count * _PAIR.size:
        raise FirmwareError("the firmware ends within its table of images; take a whole file")
    found = tuple(_image(data, index, first, count) for index in range(count))
    _check_unused(data, first, count, min(image.offset for image in found))
    _check_apart(found)
    return found


def _image(data: bytes, index: int, first: int, count: int) -> StoredImage:
    address, size = _PAIR.unpack_from(data, first + index * _PAIR.size)
    offset = address - BASE_ADDRESS
    if offset < first + count * _PAIR.size or offset + size > len(data):
        raise FirmwareError(f"image {index} of the firmware lies outside the file; take a whole file")
    header = header_of(data[offset : offset + size])
    if (header.columns, header.rows) != (COLUMNS, ROWS):
        raise FirmwareError(
            f"image {index} of the firmware has {header.columns}x{header.rows} pixels; the mirrors are {COLUMNS}x{ROWS}"
        )
    return StoredImage(offset, size, header)


def _check_unused(data: bytes, first: int, count: int, end: int) -> None:
    """Behind the last image's entry there may be room for more, but no entry."""
    for at in range(first + count * _PAIR.size, min(end, first + TABLE_IMAGES * _PAIR.size) - _PAIR.size + 1, 8):
        address, _ = _PAIR.unpack_from(data, at)
        if first <= address - BASE_ADDRESS < len(data):
            raise FirmwareError(f"the firmware's table of images holds more than the {count} that it counts; damaged")


def _check_apart(images: tuple[StoredImage, ...]) -> None:
    """Two entries may share an image; they may not cut into one."""
    places = sorted({(image.offset, image.size) for image in images})
    for (offset, size), (after, _) in itertools.pairwise(places):
        if offset + size > after:
            raise FirmwareError("images of the firmware overlap; the file is damaged")


def image_table(start: int, blobs: list[bytes]) -> bytes:
    """The table of images for a file whose images begin at ``start``: room for 256, whose blobs follow one another."""
    room = _BLOCK.size + TABLE_IMAGES * _PAIR.size
    address = BASE_ADDRESS + start + room
    table = _BLOCK.pack(*_MAGIC, len(blobs))
    for blob in blobs:
        table += _PAIR.pack(address, len(blob))
        address += len(blob)
    return table.ljust(room, b"\xff")
