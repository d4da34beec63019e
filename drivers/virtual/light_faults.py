"""What planted faults do to the light of an exposure."""

from __future__ import annotations

import numpy as np

from drivers.virtual.faults import SequenceFaults
from models.capture import Image
from models.geometry.rig import Side

_LAMP_OUT_SHARE = 64


def spoilt(image: Image, white_level: int, side: Side, index: int, faults: SequenceFaults) -> Image:
    """The image (H, W) of one camera at pulse ``index``, with what is wrong with the light then."""
    if faults.since("dark", side, index):
        image = image // image.dtype.type(_LAMP_OUT_SHARE)
    moved = faults.since("moved", side, index)
    if moved is not None:
        image = np.roll(image, moved.shift_px, axis=1)
    if faults.since("saturated", side, index):
        image = np.where(image > 0, image.dtype.type(white_level), image)
    return image
