"""What the registers hold after power-up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.values import (
    Currents,
    Input,
    InternalColour,
    LedEnable,
    LutControl,
    Mailbox,
    Mode,
    PatternSource,
    PixelFormat,
    Source,
    Timing,
    TriggerMode,
    TriggerOutput,
)

TICKS_PER_MS = 18667
"""Unit of the image load time."""
DEFAULTS: Mapping[Command[Any], Any] = {
    c.DISPLAY_MODE: Mode.VIDEO,
    c.INPUT_SOURCE: Input(Source.PARALLEL),
    c.PIXEL_FORMAT: PixelFormat.RGB444,
    c.CHANNEL_SWAP: 4,
    c.TEST_PATTERN: 0,
    c.TEST_COLOUR: InternalColour(1023, 1023, 1023, 0, 0, 0),
    c.GAMMA: 0x80,
    c.STILL_IMAGE: 0,
    c.FLIP_LONG: 0,
    c.FLIP_SHORT: 0,
    c.LED_ENABLE: LedEnable.SEQUENCER,
    c.LED_POLARITY: 0,
    c.LED_CURRENT: Currents(0x68, 0x87, 0x82),
    c.PATTERN_SOURCE: PatternSource.FLASH,
    c.TRIGGER_MODE: TriggerMode.INTERNAL,
    c.TRIGGER_OUTPUT: TriggerOutput(0, 0xBB, 0xBB),
    c.TIMING: Timing(8333, 8333),
    c.LUT_CONTROL: LutControl(1, True, 1, 1),
    c.MAILBOX_OFFSET: 0,
    c.MAILBOX_SELECT: Mailbox.CLOSED,
}
