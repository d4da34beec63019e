"""Flash images and video frames as 24-bit files. An image here is (rows, columns, 3): green, red, blue."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np

from drivers.lightcrafter.splash import FirmwareError, Pixels

_FILE_ORDER = [2, 0, 1]
"""Blue, green, red of green, red, blue."""
_OUR_ORDER = [1, 2, 0]
_HEADER = struct.Struct("<2sIHHIIiiHHI")
_BITS, _UNCOMPRESSED = 24, 0
_LARGEST_SIDE = 4096


def write_image(path: Path, image: Pixels) -> None:
    """Write a colour image, uint8, in the format of the suffix: .bmp (bottom-up, uncompressed) or .png."""
    encoded, data = cv2.imencode(path.suffix, np.ascontiguousarray(image[..., _FILE_ORDER]))
    if not encoded:
        raise OSError(f"{path} could not be encoded")
    path.write_bytes(data.tobytes())


def read_bitmap(path: Path) -> Pixels:
    """The image of a 24-bit BMP without compression; FirmwareError naming the file for anything else."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FirmwareError(f"image {path} cannot be read: {error.strerror or error}") from error
    if len(data) < _HEADER.size:
        raise FirmwareError(f"image {path} is no BMP; save it as 24-bit BMP without compression")
    magic, _, _, _, at, _, columns, rows, _, bits, compression = _HEADER.unpack_from(data)
    if magic != b"BM" or bits != _BITS or compression != _UNCOMPRESSED:
        raise FirmwareError(f"image {path} is no 24-bit BMP without compression; save it as one")
    height = abs(rows)
    if not (0 < columns <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
        raise FirmwareError(f"image {path} would have {columns}x{height} pixels; its header is damaged")
    stride = -(-3 * columns // 4) * 4
    if at < _HEADER.size or len(data) < at + stride * height:
        raise FirmwareError(f"image {path} is cut off; restore it")
    lines = np.frombuffer(data, np.uint8, stride * height, at).reshape(height, stride)
    pixels = lines[:, : 3 * columns].reshape(height, columns, 3)[..., _OUR_ORDER]
    return np.ascontiguousarray(pixels[::-1] if rows > 0 else pixels)
