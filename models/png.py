"""Single-channel PNGs, read with proof that nothing of them is missing."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.errors import CaptureError

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COMPRESSION = 1


def read_png(path: Path) -> Image:
    """A single-channel PNG as uint8 or uint16 (height, width).

    Raises CaptureError naming the file when it is absent, damaged anywhere, or in colour.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{path}: not readable ({error.strerror or error})") from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if is_whole_png(data) else None
    if image is None:
        raise CaptureError(f"{path}: not a whole PNG (truncated or damaged); restore it or capture again")
    if image.ndim != 2:
        raise CaptureError(
            f"{path}: has {image.shape[2]} channels; captures hold single-channel PNGs; "
            "'duofringe import' takes one channel of a colour set"
        )
    if image.dtype == np.uint16:
        return image.astype(np.uint16, copy=False)
    return image.astype(np.uint8, copy=False)


def write_png(path: Path, image: Image) -> None:
    """Write a single-channel PNG; raises CaptureError when the file cannot be written."""
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, _COMPRESSION]):
        raise CaptureError(f"{path}: could not be written; is the disk full?")


def is_whole_png(data: bytes) -> bool:
    """Every chunk is there up to the closing one, with the right checksum; OpenCV fills what lacks and says nothing."""
    if not data.startswith(PNG_SIGNATURE):
        return False
    at = len(PNG_SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        end = at + 8 + length
        if end + 4 > len(data) or struct.unpack_from(">I", data, end)[0] != zlib.crc32(data[at + 4 : end]):
            return False
        if data[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False
