"""Truth arrays in ``.npy`` files, whose headers are checked against the file before memory is taken for them."""

from __future__ import annotations

import io
import math
import tokenize
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy_format

from models.errors import CaptureError

_READERS = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}


class NpyHeader(NamedTuple):
    """Shape and kind of an array on disk."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def npy_header(path: Path) -> NpyHeader:
    """Header of an ``.npy`` of booleans, integers or floats whose values fill the file exactly.

    Raises CaptureError naming the file when it is anything else.
    """
    try:
        with path.open("rb") as file:
            version = npy_format.read_magic(file)
            if version not in _READERS:
                raise ValueError(f"version {version[0]}.{version[1]} of the format; 1.0 and 2.0 are read")
            shape, _, dtype = _READERS[version](file)
            values = path.stat().st_size - file.tell()
    except (OSError, ValueError, EOFError, TypeError, SyntaxError, RecursionError, tokenize.TokenError) as error:
        raise CaptureError(f"{path}: truth is not readable ({_one_line(error)})") from error
    if dtype.hasobject:
        raise CaptureError(f"{path}: truth is not readable (it holds Python objects)")
    if dtype.kind not in "biuf" or dtype.subdtype is not None:
        raise CaptureError(f"{path}: truth is not an array of numbers")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != values:
        raise CaptureError(
            f"{path}: truth is not readable (the file does not hold the shape {_short(shape)} of its header)"
        )
    return NpyHeader(shape, dtype)


def read_npy(path: Path) -> npt.NDArray[Any]:
    """An array of numbers; raises CaptureError as ``npy_header`` does."""
    npy_header(path)
    try:
        array: npt.NDArray[Any] = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise CaptureError(f"{path}: truth is not readable ({_one_line(error)})") from error
    return array


def write_npy(path: Path, array: npt.NDArray[Any]) -> None:
    """Write an array of numbers; an OSError tells why it failed, which numpy's own writing to a file forgets."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    path.write_bytes(buffer.getbuffer())


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def _short(shape: tuple[int, ...]) -> str:
    text = "x".join(str(n) for n in shape[:8]) or "()"
    return text if len(text) <= 60 else text[:60] + "..."
