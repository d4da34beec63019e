"""What a simulated camera sees."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.gigevision.features import SENSOR_SIZE
from drivers.gigevision.protocol import PIXEL_FORMATS
from models.capture import Image

ImageMaker = Callable[[int, float, float], Image]
"""(index of the pulse, exposure in us, gain in dB) -> (height, width) uint8, or uint16 with 12 bits.

Of the size that the camera delivers; or as large as the sensor, or smaller and seen in its middle: then the region of
interest is cut out of it.
"""
_STEP = 8
_BRIGHT_US = 10_000.0
_NUMBER_ROWS, _NUMBER_BITS = 8, 16


def numbered_ramp(index: int, exposure_us: float, gain_db: float, size: tuple[int, int]) -> Image:
    """A ramp along both axes that moves ``_STEP`` grey levels an index and saturates, uint8.

    Its topmost rows bear the index, which ``number_on`` reads. size: width, height px, at least 16x8.
    """
    width, height = size
    ramp = np.add.outer(np.arange(height), np.arange(width) + _STEP * index).astype(np.uint8)
    bright = min(exposure_us / _BRIGHT_US, 100.0) * 10 ** (gain_db / 20)
    levels = np.minimum(np.arange(256) * bright, 255).astype(np.uint8)
    seen: Image = levels[ramp]
    bits = index >> np.arange(_NUMBER_BITS) & 1
    seen[:_NUMBER_ROWS] = (255 * bits[np.arange(width) * _NUMBER_BITS // width]).astype(np.uint8)
    return seen


def number_on(image: Image) -> int:
    """The index that a numbered ramp bears, modulo 65,536."""
    width = image.shape[1]
    middles = (2 * np.arange(_NUMBER_BITS) + 1) * width // (2 * _NUMBER_BITS)
    lit = image[_NUMBER_ROWS // 2, middles] > 0
    return int((lit << np.arange(_NUMBER_BITS)).sum())


def _on_the_sensor(image: Image) -> Image:
    """The image in the middle of the sensor, dark around it."""
    sensor = np.zeros(SENSOR_SIZE[::-1], image.dtype)
    rows, columns = image.shape
    top, left = (sensor.shape[0] - rows) // 2, (sensor.shape[1] - columns) // 2
    sensor[top : top + rows, left : left + columns] = image
    return sensor


def as_pixels(image: Image, roi: tuple[int, int, int, int], pixel_format: int) -> bytes:
    """An image as the stream carries it; 12 bits stand in the upper bits of 16, low byte first."""
    width, height, x, y = roi
    if image.shape != (height, width):
        image = _on_the_sensor(image)[y : y + height, x : x + width]
    if pixel_format == PIXEL_FORMATS["Mono8"]:
        narrow = image if image.dtype == np.uint8 else (image >> 4).astype(np.uint8)
        return narrow.tobytes()
    wide = image.astype("<u2") << (8 if image.dtype == np.uint8 else 4)
    return wide.tobytes()
