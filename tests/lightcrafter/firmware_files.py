"""Firmware files laid out like TI's, which may not be passed on: noise stands for the program."""

from __future__ import annotations

import struct

import numpy as np

from drivers.lightcrafter.firmware import FirmwareFile
from drivers.lightcrafter.flash_table import BASE_ADDRESS, COLUMNS, ROWS
from drivers.lightcrafter.splash import Pixels, encode_image

SPLASH_AT = 0x20400


def base_file(splash_at: int = SPLASH_AT, images: int = 1, seed: int = 1) -> bytes:
    """A file with a table of exactly its images, which are black."""
    data = bytearray(np.random.default_rng(seed).integers(0, 256, splash_at, dtype=np.uint8).tobytes())
    struct.pack_into("<4I", data, 0x20000, 0x01234567, BASE_ADDRESS, 0x13, 0)
    data[0x20010 : 0x20000 + 464] = b"\xff" * 448
    struct.pack_into("<II", data, 0x20010, BASE_ADDRESS + 0x20200, splash_at - 0x20200)
    struct.pack_into("<II", data, 0x20010 + 20 * 8, BASE_ADDRESS + splash_at, 0xFFFFFFFF)
    blob = encode_image(np.zeros((ROWS, COLUMNS, 3), np.uint8))
    data += struct.pack("<3I", 0x12345678, 0x87654321, images)
    first = BASE_ADDRESS + splash_at + 12 + 8 * images
    for k in range(images):
        data += struct.pack("<II", first + k * len(blob), len(blob))
    return bytes(data) + blob * images


def stripes(seed: int) -> Pixels:
    """An image of noise along its columns, which takes 11 KB."""
    row = np.random.default_rng(seed).integers(0, 256, (1, COLUMNS, 3), dtype=np.uint8)
    return np.ascontiguousarray(np.broadcast_to(row, (ROWS, COLUMNS, 3)))


def firmware(splash_at: int, images: int, seed: int) -> bytes:
    """A whole file as it is built, with images of its own."""
    return FirmwareFile.parse(base_file(splash_at, seed=seed)).with_images([stripes(seed + k) for k in range(images)])
