"""Pixels and truth on disk: what is too large or claims too much is refused before memory is taken for it."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from memory import memory_taken_below

from models.errors import CaptureError
from models.npy import npy_header, read_npy, write_npy
from models.png import MAXIMUM_PIXELS, png_header, read_png, read_pngs, write_png, write_pngs

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def test_memory_is_measured() -> None:
    with pytest.raises(AssertionError, match="MiB"), memory_taken_below(50):
        np.ones(100 << 20, np.uint8)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def make_png(width: int, height: int, bit_depth: int = 8, colour: int = 0, extra: bytes = b"") -> bytes:
    """A PNG of zeros whose pixels take a thousandth of their size."""
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    row = b"\0" * (1 + width * channels * bit_depth // 8)
    squeeze = zlib.compressobj(9)
    data = b"".join(squeeze.compress(row) for _ in range(height)) + squeeze.flush()
    header = struct.pack(">IIBBBBB", width, height, bit_depth, colour, 0, 0, 0)
    return SIGNATURE + chunk(b"IHDR", header) + extra + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("width", "height", "colour", "named"),
    [
        (40_000, 1_000, 0, "40000x1000 pixels; at most 32 megapixels"),
        (1_000, 32_001, 0, "at most 32 megapixels"),
        (6_000, 5_000, 6, "has 4 channels"),
        (6_000, 5_000, 2, "has 3 channels"),
    ],
)
def test_large_or_coloured_images_are_refused_undecoded(
    tmp_path: Path, width: int, height: int, colour: int, named: str
) -> None:
    path = tmp_path / "white.png"
    path.write_bytes(make_png(width, height, 8, colour))
    with memory_taken_below(20), pytest.raises(CaptureError, match=named):
        read_png(path)


def test_the_largest_image_is_read(tmp_path: Path) -> None:
    path = tmp_path / "white.png"
    path.write_bytes(make_png(8_000, MAXIMUM_PIXELS // 8_000))
    assert read_png(path).shape == (4_000, 8_000)


@pytest.mark.parametrize("kind", [b"zTXt", b"iCCP"])
def test_notes_inside_an_image_take_no_memory(tmp_path: Path, kind: bytes) -> None:
    bomb = zlib.compress(b"\0" * 300_000_000, 9)
    path = tmp_path / "white.png"
    path.write_bytes(make_png(64, 48, extra=chunk(kind, b"note\0\0" + bomb)))
    with memory_taken_below(50):
        assert read_png(path).shape == (48, 64)


def test_header_tells_size_and_depth(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.zeros((12, 34), np.uint16))
    assert png_header(tmp_path / "a.png") == (34, 12, 16, 1)
    (tmp_path / "b.png").write_bytes((tmp_path / "a.png").read_bytes()[:30])
    with pytest.raises(CaptureError, match=r"b\.png: not a whole PNG"):
        png_header(tmp_path / "b.png")
    with pytest.raises(CaptureError, match=r"c\.png: not readable"):
        png_header(tmp_path / "c.png")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_many_images_at_once_keep_their_order(tmp_path: Path, dtype: type) -> None:
    draw = np.random.default_rng(1)
    images = {tmp_path / f"{i}.png": draw.integers(0, 200, (20, 30)).astype(dtype) for i in range(25)}
    write_pngs(images)
    for (path, image), read in zip(images.items(), read_pngs(list(images)), strict=True):
        np.testing.assert_array_equal(read, image)
        np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), image)
    assert read_pngs([]) == []
    write_pngs({})


def test_a_fault_in_one_of_many_images_is_told(tmp_path: Path) -> None:
    image = np.zeros((4, 4), np.uint8)
    with pytest.raises(CaptureError, match=r"no/b\.png: could not be written \(No such file"):
        write_pngs({tmp_path / "a.png": image, tmp_path / "no" / "b.png": image})
    with pytest.raises(CaptureError, match=r"b\.png: not readable"):
        read_pngs([tmp_path / "a.png", tmp_path / "b.png"])


def npy(header: bytes, version: bytes = b"\x01\x00", values: bytes = b"") -> bytes:
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header + values


@pytest.mark.parametrize(
    "content",
    [
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), "),
        npy(b"(((("),
        npy(b"(" * 3000),
        npy(b"'''"),
        npy(b"\0\0"),
        npy(b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", values=b"\x80\x04K\x01."),
        npy(b"{'descr': '<U1', 'fortran_order': False, 'shape': (1,), }", values=b"abcd"),
        npy(b"{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,), }", values=b"abcd"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (100000, 100000), }", values=b"abcd"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999, 4), }"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -1), }", values=b"abcd"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", values=b"abcde"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", version=b"\x09\x09", values=b"abcd"),
        b"PK\x03\x04",
        b"",
    ],
)
def test_arrays_that_are_not_what_they_say(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "depth.npy").write_bytes(content)
    for read in (npy_header, read_npy):
        with pytest.raises(CaptureError, match=r"depth\.npy: truth is not") as caught:
            read(tmp_path / "depth.npy")
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400 + len(str(tmp_path))


@pytest.mark.parametrize("array", [np.zeros((3, 4), np.float32), np.ones(7, np.bool_), np.zeros((0, 5), np.int16)])
def test_arrays_round_trip(tmp_path: Path, array: np.ndarray) -> None:
    write_npy(tmp_path / "a.npy", array)
    assert npy_header(tmp_path / "a.npy") == (array.shape, array.dtype)
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy"), array)
