"""Single-channel PNGs, read with proof that nothing of them is missing."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from models.errors import CaptureError

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAXIMUM_PIXELS = 32_000_000
"""More pixels than any camera of a rig has; a larger number in a file is damage, or meant to fill the memory."""
_ENCODING = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
)
"""Rows of vertical fringes are alike but for noise, in which a search for repetitions finds nothing: half the time
and four fifths of the bytes of the plain level 1."""
_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_HEADER_BYTES = len(PNG_SIGNATURE) + 4 + 4 + 13 + 4
_MOST_THREADS = 8


class PngHeader(NamedTuple):
    """What a PNG says of itself before its pixels. bit_depth: per channel, 1..16."""

    width: int
    height: int
    bit_depth: int
    channels: int


def png_header(path: Path) -> PngHeader:
    """Size and depth of a PNG without decoding it.

    Raises CaptureError naming the file when it is absent, no PNG, or larger than MAXIMUM_PIXELS.
    """
    try:
        with path.open("rb") as file:
            return _parse_header(path, file.read(_HEADER_BYTES))
    except OSError as error:
        raise CaptureError(f"{path}: not readable ({error.strerror or error})") from error


def _parse_header(path: Path, data: bytes) -> PngHeader:
    if (
        len(data) < _HEADER_BYTES
        or not data.startswith(PNG_SIGNATURE + b"\0\0\0\rIHDR")
        or zlib.crc32(data[12:29]) != int.from_bytes(data[29:33], "big")
    ):
        raise CaptureError(f"{path}: not a whole PNG (truncated or damaged); restore it or capture again")
    width, height, bit_depth, colour = struct.unpack_from(">IIBB", data, 16)
    if width * height > MAXIMUM_PIXELS:
        raise CaptureError(
            f"{path}: has {width}x{height} pixels; at most {MAXIMUM_PIXELS // 1_000_000} megapixels are read"
        )
    return PngHeader(width, height, bit_depth, _CHANNELS.get(colour, 0))


def read_png(path: Path) -> Image:
    """A single-channel PNG as uint8 or uint16 (height, width).

    Raises CaptureError naming the file when it is absent, damaged anywhere, in colour, or larger than MAXIMUM_PIXELS;
    size and colour are looked at before anything is decoded.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{path}: not readable ({error.strerror or error})") from error
    header = _parse_header(path, data)
    if header.channels > 1:
        raise _not_single(path, header.channels)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if is_whole_png(data) else None
    if image is None:
        raise CaptureError(f"{path}: not a whole PNG (truncated or damaged); restore it or capture again")
    if image.ndim != 2:
        raise _not_single(path, image.shape[2])
    if image.dtype == np.uint16:
        return image.astype(np.uint16, copy=False)
    return image.astype(np.uint8, copy=False)


def _not_single(path: Path, channels: int) -> CaptureError:
    return CaptureError(
        f"{path}: has {channels} channels; captures hold single-channel PNGs; "
        "'duofringe import' takes one channel of a colour set"
    )


def read_pngs(paths: Sequence[Path]) -> list[Image]:
    """As ``read_png``, several at a time: decoding leaves the interpreter free."""
    with ThreadPoolExecutor(_threads(len(paths))) as pool:
        return list(pool.map(read_png, paths))


def write_png(path: Path, image: Image) -> None:
    """Write a single-channel PNG; raises CaptureError when the file cannot be written."""
    encoded, data = cv2.imencode(".png", image, _ENCODING)
    if not encoded:
        raise CaptureError(f"{path}: could not be written as PNG")
    try:
        path.write_bytes(data.tobytes())  # OpenCV's own writing says nothing of a full disk
    except OSError as error:
        raise CaptureError(f"{path}: could not be written ({error.strerror or error})") from error


def write_pngs(images: Mapping[Path, Image]) -> None:
    """As ``write_png``, several at a time: encoding leaves the interpreter free."""
    with ThreadPoolExecutor(_threads(len(images))) as pool:
        done: Iterable[None] = pool.map(write_png, images.keys(), images.values())
        for _ in done:  # raises what a thread raised
            pass


def _threads(count: int) -> int:
    return max(1, min(count, len(os.sched_getaffinity(0)), _MOST_THREADS))


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
