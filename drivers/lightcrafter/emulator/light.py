"""What an emulated projector emits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.emulator.flash import EmulatedFlash, FlashPixels
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.emulator.video import EmulatedVideo
from drivers.lightcrafter.values import Mode, Source

Light = npt.NDArray[np.float64]


def emitted(
    values: Mapping[Command[Any], Any], showing: Exposure | None, flash: EmulatedFlash, video: EmulatedVideo
) -> Light:
    """(rows, columns, 3) red, green, blue, 0..255, with the LEDs inverted as on the EVM while their polarity is 0."""
    drive = led_drive(values)
    dark = np.zeros((*flash.image(0).shape[:2], 3))
    if values[c.DISPLAY_MODE] is Mode.PATTERN:
        if showing is None:
            return dark
        chosen = np.array([bool(int(showing.entry.leds) >> k & 1) for k in range(3)], np.float64)
        return np.asarray(showing.levels[..., None] * (chosen * drive))
    source = values[c.INPUT_SOURCE].source
    if source is Source.TEST_PATTERN:
        return np.asarray(dark + np.asarray(values[c.TEST_COLOUR][:3]) / 1023 * 255 * drive)
    if source is Source.FLASH:
        return _in_colours(flash.image(values[c.STILL_IMAGE])) * drive
    picture = video.picture(dark.shape[1], dark.shape[0]) if source is Source.PARALLEL else None
    return dark if picture is None else _in_colours(picture) * drive


def _in_colours(planes: FlashPixels) -> Light:
    green, red, blue = np.moveaxis(planes.astype(np.float64), -1, 0)
    return np.stack([red, green, blue], axis=-1)


def led_drive(values: Mapping[Command[Any], Any]) -> Light:
    """Of the red, green and blue LED, 0..1."""
    drive = np.asarray(values[c.LED_CURRENT], np.float64) / 255
    return drive if values[c.LED_POLARITY] else 1 - drive
