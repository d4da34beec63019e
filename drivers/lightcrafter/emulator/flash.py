"""Images in an emulated flash, and how long they take to come out of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.lightcrafter import planes
from drivers.lightcrafter.splash import encode_image

_SLOWEST_LOAD_US = 200_000.0
"""Of an image that is not compressed; the controller's makers speak of up to 200 ms."""
_SETUP_US = 1_000.0

FlashPixels = npt.NDArray[np.uint8]


class EmulatedFlash:
    """images: (rows, columns, 3) uint8 each, in the order of the planes: green, red, blue."""

    def __init__(self, images: Sequence[FlashPixels]) -> None:
        self._images = tuple(images)
        self._loads_us = tuple(_load_us(image) for image in self._images)

    def __len__(self) -> int:
        return len(self._images)

    def image(self, index: int) -> FlashPixels:
        return self._images[index]

    def load_us(self, index: int) -> float:
        """Time from flash into a buffer."""
        return self._loads_us[index]

    def shown(self, index: int, number: int, depth: int) -> FlashPixels:
        """Levels on the mirrors (rows, columns), 0..255."""
        return planes.shown(self._images[index], number, depth)


def _load_us(image: FlashPixels) -> float:
    return _SETUP_US + (_SLOWEST_LOAD_US - _SETUP_US) * min(1.0, len(encode_image(image)) / image.size)
