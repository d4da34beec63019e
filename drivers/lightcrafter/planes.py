"""Which bits of a 24-bit flash image a pattern number shows.

The 24 bit planes count G0..G7, R0..R7, B0..B7. Pattern n of depth d is the d planes from n * stride[d] + offset[d].
Source: the bit-plane table of the DLPC350 programmer's guide (table 2-66) in closed form.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

Depth = Literal[1, 8]
PLANES = 24
_STRIDE = (0, 1, 2, 3, 4, 6, 6, 8, 8)
_OFFSET = (0, 0, 0, 0, 0, 1, 0, 1, 0)
_MINIMUM_US = (0, 235, 700, 1570, 1700, 2000, 2500, 4500, 8333)


def lowest_plane(number: int, depth: int) -> int:
    """The least significant plane; ValueError where the image has no such pattern."""
    plane = number * _STRIDE[depth] + _OFFSET[depth]
    if plane + depth > PLANES:
        raise ValueError(f"pattern {number} of {depth} bits is beyond an image of {PLANES} planes")
    return plane


def minimum_exposure_us(depth: int) -> int:
    """Shortest exposure of a pattern of ``depth`` bits."""
    return _MINIMUM_US[depth]


def insert(image: npt.NDArray[np.uint8], number: int, depth: Depth, levels: npt.NDArray[np.uint8]) -> None:
    """Put a pattern (rows, columns), 0..255, into an image (rows, columns, 3) of green, red, blue."""
    plane = lowest_plane(number, depth)
    channel, bit = divmod(plane, 8)
    if depth == 8:
        image[..., channel] = levels
    else:
        image[..., channel] &= np.uint8(~(1 << bit) & 0xFF)
        image[..., channel] |= (levels >> 7) << bit


def shown(image: npt.NDArray[np.uint8], number: int, depth: int) -> npt.NDArray[np.uint8]:
    """What the mirrors show of an image (rows, columns, 3) of green, red, blue: (rows, columns), 0..255."""
    plane = lowest_plane(number, depth)
    value = np.zeros(image.shape[:2], np.uint32)
    for bit in range(depth):
        channel, place = divmod(plane + bit, 8)
        value |= (image[..., channel].astype(np.uint32) >> place & 1) << bit
    return np.asarray(np.rint(value * (255.0 / (2**depth - 1))), np.uint8)
