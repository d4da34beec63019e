"""Pixels of foreign files: PNG, JPEG, BMP or TIFF, 8 or 16 bit, one channel of a colour image."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from models.capture import Image
from models.errors import ManifestError
from models.png import PNG_SIGNATURE, is_whole_png

Channel = Literal["gray", "red", "green", "blue"]
MAXIMUM_PIXELS = 100_000_000
_BGR_INDEX = {"blue": 0, "green": 1, "red": 2}
_JPEG_START, _JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"
_TAIL_BYTES = 4096


def read_foreign_image(path: Path, channel: Channel) -> Image:
    """One channel of an image file, uint8 or uint16 of shape (height, width).

    ``gray`` takes a single-channel file as it is and the luminance of a colour file. Raises ManifestError naming the
    file when it is not a whole image, has other pixels, or lacks the channel.
    """
    content = path.read_bytes()
    if not content:
        raise ManifestError(f"{path}: is empty")
    if not _is_whole(content):
        raise ManifestError(f"{path}: the image is truncated or damaged; restore the file")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ManifestError(f"{path}: is not a readable image") from error
    if image is None:
        raise ManifestError(f"{path}: is not a readable PNG, JPEG, BMP or TIFF image")
    if image.dtype not in (np.uint8, np.uint16):
        raise ManifestError(f"{path}: has {image.dtype} pixels; sets of 8- or 16-bit images are read")
    if image.shape[0] * image.shape[1] > MAXIMUM_PIXELS:
        raise ManifestError(f"{path}: has more than {MAXIMUM_PIXELS // 1_000_000} megapixels")
    return _take_channel(image, channel, path)


def _is_whole(content: bytes) -> bool:
    """OpenCV fills what a truncated PNG or JPEG lacks with grey and says nothing."""
    if content.startswith(PNG_SIGNATURE):
        return is_whole_png(content)
    return not content.startswith(_JPEG_START) or _JPEG_END in content[-_TAIL_BYTES:]


def _take_channel(image: np.ndarray, channel: Channel, path: Path) -> Image:
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    if image.ndim == 2:
        if channel != "gray":
            raise ManifestError(f"{path}: has one channel; set images.channel to 'gray' instead of '{channel}'")
        taken = image
    elif image.shape[2] not in (3, 4):
        raise ManifestError(f"{path}: has {image.shape[2]} channels; 1, 3 or 4 are read")
    elif channel != "gray":
        taken = image[..., _BGR_INDEX[channel]]
    elif np.array_equal(image[..., 0], image[..., 1]) and np.array_equal(image[..., 0], image[..., 2]):
        taken = image[..., 0]  # a grey picture in a colour file keeps its values to the bit
    else:
        taken = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(taken)
