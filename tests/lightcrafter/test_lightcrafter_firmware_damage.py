"""Damaged firmware files: refused, or showing exactly the images of the whole one."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from firmware_files import SPLASH_AT, base_file, stripes
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.lightcrafter.firmware import FirmwareFile
from drivers.lightcrafter.flash_table import BASE_ADDRESS, BOOTLOADER_BYTES, COLUMNS, ROWS, TABLE_BYTES
from drivers.lightcrafter.splash import HEADER_BYTES, Coding, FirmwareError

SQUARES = np.kron(
    np.random.default_rng(5).integers(0, 256, (19, 19, 3), dtype=np.uint8), np.ones((60, 48, 1), np.uint8)
)
NOISE = np.random.default_rng(6).integers(0, 256, (ROWS, COLUMNS, 3), dtype=np.uint8)
IMAGES = [stripes(1), SQUARES, stripes(2)]
WHOLE = FirmwareFile.parse(base_file(images=2)).with_images(IMAGES)
FACTORY = base_file(images=3)
"""With a table of exactly its images, which are alike."""
STORED = FirmwareFile.parse(WHOLE).stored
HEADERS = [image.offset + k for image in STORED for k in range(HEADER_BYTES)]
TABLES = [
    *range(BOOTLOADER_BYTES, BOOTLOADER_BYTES + TABLE_BYTES),
    *range(SPLASH_AT, SPLASH_AT + 12 + 8 * 5),
]
few = settings(max_examples=60)


def images_of(data: bytes) -> list[bytes] | None:
    """Pixels of every image, None where the file is refused."""
    try:
        firmware = FirmwareFile.parse(data)
        return [firmware.image(k).tobytes() for k in range(len(firmware.blobs))]
    except FirmwareError:
        return None


SHOWN = images_of(WHOLE)


def test_the_whole_file_uses_each_coding() -> None:
    assert images_of(WHOLE) == [image.tobytes() for image in IMAGES]
    assert [image.header.coding for image in STORED] == [Coding.FOUR_LINES, Coding.RUNS, Coding.FOUR_LINES]
    raw = FirmwareFile.parse(FirmwareFile.parse(base_file()).with_images([NOISE]))
    assert raw.stored[0].header.coding is Coding.RAW
    assert np.array_equal(raw.image(0), NOISE)


@given(st.integers(0, len(WHOLE) - 1))
def test_a_file_that_is_cut_anywhere_is_refused(size: int) -> None:
    assert images_of(WHOLE[:size]) is None


@pytest.mark.parametrize("size", [*range(BOOTLOADER_BYTES + TABLE_BYTES - 3, BOOTLOADER_BYTES + TABLE_BYTES + 3)])
def test_a_file_that_is_cut_at_its_tables_is_refused(size: int) -> None:
    assert images_of(WHOLE[:size]) is None


@few
@given(st.sampled_from(TABLES + HEADERS), st.integers(1, 255))
def test_a_changed_byte_of_a_table_or_a_header_is_seen_or_does_no_harm(at: int, change: int) -> None:
    damaged = WHOLE[:at] + bytes([WHOLE[at] ^ change]) + WHOLE[at + 1 :]
    assert images_of(damaged) in (None, SHOWN)


@pytest.mark.parametrize("image", range(3))
@pytest.mark.parametrize(("place", "value"), [(k, v) for k in (0, 4, 6, 8, 24, 25, 26) for v in (0x01, 0x80, 0xFF)])
def test_what_a_header_must_say_cannot_be_changed(image: int, place: int, value: int) -> None:
    """Magic, width, height, size, pixel format, coding, byte order."""
    at = STORED[image].offset + place
    damaged = WHOLE[:at] + bytes([WHOLE[at] ^ value]) + WHOLE[at + 1 :]
    found = images_of(damaged)
    assert found is None or (place == 8 and found == SHOWN), "a size within the padding may pass"


@few
@given(st.data())
def test_a_changed_byte_of_coded_pixels_is_seen_or_gives_an_image_of_the_right_size(
    data: st.DataObject,
) -> None:
    """The file has no checksum: its record has."""
    at = STORED[1].offset + data.draw(st.integers(HEADER_BYTES, STORED[1].size - 1))
    damaged = WHOLE[:at] + bytes([WHOLE[at] ^ data.draw(st.integers(1, 255))]) + WHOLE[at + 1 :]
    found = images_of(damaged)
    assert found is None or [len(pixels) for pixels in found] == [3 * COLUMNS * ROWS] * 3


@pytest.mark.parametrize("count", [0, 1, 2, 4, 5, 256, 257, 0xFFFFFFFF])
@pytest.mark.parametrize("data", [WHOLE, FACTORY], ids=["room for 256", "exact"])
def test_a_wrong_count_of_images_is_refused(data: bytes, count: int) -> None:
    damaged = bytearray(data)
    struct.pack_into("<I", damaged, SPLASH_AT + 8, count)
    assert images_of(bytes(damaged)) is None


def test_images_that_overlap_are_refused_and_shared_ones_are_not() -> None:
    first, second = STORED[0], STORED[1]
    overlapping, shared = bytearray(WHOLE), bytearray(WHOLE)
    struct.pack_into("<I", overlapping, SPLASH_AT + 12 + 4, first.size + 64)
    assert second.offset == first.offset + first.size
    with pytest.raises(FirmwareError, match="overlap"):
        FirmwareFile.parse(bytes(overlapping))
    struct.pack_into("<II", shared, SPLASH_AT + 12 + 8 * 2, BASE_ADDRESS + first.offset, first.size)
    found = images_of(bytes(shared))
    assert found is not None
    assert found[2] == found[0]


@pytest.mark.parametrize(
    ("at", "value", "reason"),
    [
        (0, 0x01234568, "no flash table at 0x20000"),
        (4, 0xFA000000, "begins at 0xFA000000"),
        (16, BASE_ADDRESS + 0x1000, r"AppCode\[0\] at 0xF9001000"),
        (16, BASE_ADDRESS + SPLASH_AT, r"AppCode\[0\]"),
        (20, 0x10000000, r"AppCode\[0\]"),
        (16 + 8 * 4, BASE_ADDRESS + 0x2000000, r"ASIC\[0\]"),
        (16 + 8 * 20, 0xFFFFFFFF, "names no images"),
        (16 + 8 * 20, BASE_ADDRESS + 0x8000, "outside the file"),
    ],
)
def test_a_flash_table_that_cannot_be_is_refused(at: int, value: int, reason: str) -> None:
    damaged = bytearray(WHOLE)
    struct.pack_into("<I", damaged, BOOTLOADER_BYTES + at, value)
    with pytest.raises(FirmwareError, match=reason):
        FirmwareFile.parse(bytes(damaged))
