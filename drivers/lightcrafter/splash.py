"""Images as the controller's flash stores them: a header of 32 bytes and pixels in one of three codings.

raw: three bytes a pixel. run: [n >= 1][pixel] repeats it, [0][n >= 2][n pixels] takes them as they are, [0][0] ends a
line (zeros follow up to a multiple of 4 bytes), [0][1] ends the image (up to a multiple of 16). four lines: only lines
0 to 3, for images whose line y is their line y modulo 4. A pixel's bytes come as blue, red, green.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from models.errors import DuofringeError

Pixels = npt.NDArray[np.uint8]
HEADER_BYTES = 32
LINES = 4
_MAGIC = 0x636C7053
_NONE = 0xFFFFFFFF
_HEADER = struct.Struct("<IHHIIIIBBBB4s")
_LONGEST_RUN = 255
_LARGEST_SIDE = 4096
_PIXEL_FORMAT, _BYTE_ORDER = 1, 1


class FirmwareError(DuofringeError):
    """A firmware file, or an image in it, is damaged or not for this projector."""


class Coding(IntEnum):
    """Compression byte of an image."""

    RAW = 0
    RUNS = 1
    FOUR_LINES = 4


@dataclass(frozen=True)
class ImageHeader:
    """data_bytes: of the coded pixels."""

    columns: int
    rows: int
    data_bytes: int
    coding: Coding


def encode_image(image: Pixels) -> bytes:
    """An image (rows, columns, 3) of green, red, blue with its header, in the coding that takes least.

    Images of a few lines that repeat load fastest and are always stored as such.
    """
    pixels = np.ascontiguousarray(image[..., ::-1])
    rows, columns = pixels.shape[:2]
    if np.array_equal(pixels, pixels[np.arange(rows) % LINES]):
        return _with_header(pixels[:LINES].tobytes(), columns, rows, Coding.FOUR_LINES)
    if _least_bytes_of_runs(pixels) < pixels.size:
        data = _encode_runs(pixels)
        if len(data) < pixels.size:
            return _with_header(data, columns, rows, Coding.RUNS)
    return _with_header(pixels.tobytes(), columns, rows, Coding.RAW)


def header_of(blob: bytes) -> ImageHeader:
    """The header of an image and its pixels; FirmwareError where it cannot be true."""
    if len(blob) < HEADER_BYTES:
        raise FirmwareError(f"an image of the firmware is cut off after {len(blob)} bytes; take a whole file")
    magic, columns, rows, size, _, _, _, form, coding, order, _, _ = _HEADER.unpack_from(blob)
    if magic != _MAGIC or form != _PIXEL_FORMAT or order != _BYTE_ORDER or coding not in tuple(Coding):
        raise FirmwareError("an image of the firmware has no valid header; take another file")
    if not (0 < columns <= _LARGEST_SIDE and 0 < rows <= _LARGEST_SIDE):
        raise FirmwareError(f"an image of the firmware would have {columns}x{rows} pixels; take another file")
    if HEADER_BYTES + size > len(blob):
        raise FirmwareError(f"an image of the firmware has {len(blob)} bytes and says {size}; the file is damaged")
    return ImageHeader(columns, rows, size, Coding(coding))


def decode_image(blob: bytes) -> Pixels:
    """The image (rows, columns, 3) of green, red, blue of a header and what follows it; FirmwareError if damaged."""
    header = header_of(blob)
    columns, rows, coding = header.columns, header.rows, header.coding
    data = blob[HEADER_BYTES : HEADER_BYTES + header.data_bytes]
    line = 3 * columns
    if coding == Coding.RUNS:
        pixels = _decode_runs(data, columns, rows)
    elif coding == Coding.RAW and len(data) == line * rows:
        pixels = np.frombuffer(data, np.uint8).reshape(rows, columns, 3)
    elif coding == Coding.FOUR_LINES and len(data) == line * min(LINES, rows):
        stored = np.frombuffer(data, np.uint8).reshape(-1, columns, 3)
        pixels = stored[np.arange(rows) % LINES]
    else:
        raise FirmwareError(
            f"an image of the firmware has {len(data)} bytes in coding {coding.value}; the file is damaged"
        )
    return np.ascontiguousarray(pixels[..., ::-1])


def _with_header(data: bytes, columns: int, rows: int, coding: Coding) -> bytes:
    fields = (_MAGIC, columns, rows, len(data), _NONE, _NONE, 0, _PIXEL_FORMAT, coding, _BYTE_ORDER, 0, bytes(4))
    return _HEADER.pack(*fields) + data


def _least_bytes_of_runs(pixels: Pixels) -> int:
    """A pixel takes part in a run of 4 bytes, or stands with others for 3 each."""
    changes = np.count_nonzero(np.any(pixels[:, 1:] != pixels[:, :-1], axis=2))
    return 3 * int(changes)


def _encode_runs(pixels: Pixels) -> bytes:
    out = bytearray()
    known: dict[bytes, bytes] = {}
    for line in pixels:
        key = line.tobytes()
        if key not in known:
            known[key] = _encode_line(line)
        out += known[key]
    out += b"\x00\x01"
    return bytes(out) + bytes(-len(out) % 16)


def _encode_line(line: Pixels) -> bytes:
    """Whole lines are padded, so each begins at a multiple of 4 whatever came before."""
    starts = np.flatnonzero(np.r_[True, np.any(line[1:] != line[:-1], axis=1)])
    lengths = np.diff(np.r_[starts, len(line)])
    out = bytearray()
    loose: list[bytes] = []
    for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
        pixel = line[start].tobytes()
        if length == 1:
            loose.append(pixel)
            continue
        out += _literal(loose)
        loose = []
        for done in range(0, length, _LONGEST_RUN):
            out += bytes([min(_LONGEST_RUN, length - done)]) + pixel
    out += _literal(loose) + b"\x00\x00"
    return bytes(out) + bytes(-len(out) % 4)


def _literal(pixels: list[bytes]) -> bytes:
    out = b""
    for start in range(0, len(pixels), _LONGEST_RUN):
        chunk = pixels[start : start + _LONGEST_RUN]
        # one pixel cannot be a literal: [0][1] would end the image
        out += b"\x01" + chunk[0] if len(chunk) == 1 else bytes([0, len(chunk)]) + b"".join(chunk)
    return out


def _decode_runs(data: bytes, columns: int, rows: int) -> Pixels:
    lines: list[bytes] = []
    line = bytearray()
    at = 0
    while at + 1 < len(data) and len(lines) < rows:
        count, second = data[at], data[at + 1]
        if count:
            line += data[at + 1 : at + 4] * count
            at += 4
        elif second > 1:
            line += data[at + 2 : at + 2 + 3 * second]
            at += 2 + 3 * second
        else:
            if line:
                lines.append(bytes(line))
                line.clear()
            if second == 1:
                break
            at = -(-(at + 2) // 4) * 4
        if len(line) > 3 * columns:
            raise FirmwareError("an image of the firmware has a line that is too long; the file is damaged")
    if len(lines) != rows or any(len(done) != 3 * columns for done in lines):
        raise FirmwareError("an image of the firmware is incomplete; the file is damaged")
    return np.frombuffer(b"".join(lines), np.uint8).reshape(rows, columns, 3)
