"""The controller's commands: one table, from which both transports and the emulator read.

Source: TI DLPC350 programmer's guide (DLPU010) by way of the code of the GUI that TI publishes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Flag
from typing import Any, Generic, TypeVar

from drivers.errors import ProtocolError
from drivers.lightcrafter import codecs
from drivers.lightcrafter.codecs import Codec, PayloadError, byte, fields, integer
from drivers.lightcrafter.values import (
    Currents,
    HardwareStatus,
    ImageRange,
    Input,
    InternalColour,
    InternalPattern,
    LedEnable,
    LutControl,
    LutEntry,
    Mailbox,
    MainStatus,
    Mode,
    PatternSource,
    PixelFormat,
    Power,
    Run,
    Timing,
    TriggerMode,
    TriggerOutput,
    Validation,
    Versions,
    VideoSignal,
)

NAME = "projector"
"""Role in the rig; begins every error."""
T = TypeVar("T")


class Access(Flag):
    """Which way a command's payload may go."""

    READ = 1
    WRITE = 2
    BOTH = 3


@dataclass(frozen=True)
class Command(Generic[T]):
    """One command.

    usb: CMD2 and CMD3 as one number, 0x1A24. register: of I2C, None where the sheet knows none. answer_bytes: most
    that a read gives, where the payload's size varies.
    """

    name: str
    usb: int
    register: int | None
    access: Access
    codec: Codec[T]
    answer_bytes: int = 0

    @property
    def read_size(self) -> int:
        """Bytes to ask for."""
        return self.codec.size or self.answer_bytes

    def encode(self, value: T) -> bytes:
        """The payload; ProtocolError where the value does not fit."""
        try:
            return self.codec.encode(value)
        except PayloadError as error:
            raise ProtocolError(NAME, f"cannot be sent '{self.name}': {error}") from error

    def decode(self, data: bytes) -> T:
        """The value of an answer; ProtocolError where it is none."""
        try:
            return self.codec.decode(data)
        except PayloadError as error:
            raise ProtocolError(NAME, f"answered nonsense to '{self.name}': {error}") from error


READ, WRITE, BOTH = Access.READ, Access.WRITE, Access.BOTH

HARDWARE_STATUS: Command[HardwareStatus] = Command("hardware status", 0x1A0A, 0x20, READ, byte(HardwareStatus))
MAIN_STATUS: Command[MainStatus] = Command("main status", 0x1A0C, 0x22, READ, byte(MainStatus))
VERSION: Command[Versions] = Command("version", 0x0205, 0x11, READ, codecs.VERSIONS)
FIRMWARE_TAG: Command[str] = Command("firmware tag", 0x1AFF, 0x5E, READ, codecs.TAG, answer_bytes=32)
FLASH_IMAGES: Command[int] = Command("number of flash images", 0x1A42, 0x0C, READ, integer(1))
POWER: Command[Power] = Command("power", 0x0200, 0x07, BOTH, byte(Power, 3))

DISPLAY_MODE: Command[Mode] = Command("display mode", 0x1A1B, 0x69, BOTH, byte(Mode, 1))
VIDEO_SIGNAL: Command[VideoSignal] = Command("video signal", 0x071C, 0x01, READ, fields(VideoSignal, "B2H3BI8H"))
CHANNEL_SWAP: Command[int] = Command("channel swap", 0x1A37, 0x04, BOTH, integer(1))
INPUT_SOURCE: Command[Input] = Command("input source", 0x1A00, 0x00, BOTH, codecs.INPUT)
PIXEL_FORMAT: Command[PixelFormat] = Command("pixel format", 0x1A02, 0x02, BOTH, byte(PixelFormat, 3))
TEST_PATTERN: Command[InternalPattern] = Command("test pattern", 0x1203, 0x0A, BOTH, byte(InternalPattern))
TEST_COLOUR: Command[InternalColour] = Command("test colour", 0x1204, 0x1A, BOTH, fields(InternalColour, "6H"))
GAMMA: Command[int] = Command("gamma", 0x1A0E, 0x31, BOTH, integer(1))
STILL_IMAGE: Command[int] = Command("flash still image", 0x1A39, 0x7F, BOTH, integer(1))
FLIP_LONG: Command[int] = Command("flip of the long axis", 0x1008, 0x08, BOTH, integer(1))
FLIP_SHORT: Command[int] = Command("flip of the short axis", 0x1009, 0x09, BOTH, integer(1))
IMAGE_LOAD_RANGE: Command[ImageRange] = Command("image load timing", 0x1A3A, None, WRITE, fields(ImageRange, "2B"))
IMAGE_LOAD_TIME: Command[int] = Command("image load timing", 0x1A3A, None, READ, integer(4))

LED_ENABLE: Command[LedEnable] = Command("LED enable", 0x1A07, 0x10, BOTH, byte(LedEnable, 15))
LED_POLARITY: Command[int] = Command("LED polarity", 0x1A05, 0x0B, BOTH, integer(1))
LED_CURRENT: Command[Currents] = Command("LED current", 0x0B01, 0x4B, BOTH, fields(Currents, "3B"))

PATTERN_SOURCE: Command[PatternSource] = Command("pattern source", 0x1A22, 0x6F, BOTH, byte(PatternSource, 3))
TRIGGER_MODE: Command[TriggerMode] = Command("pattern trigger mode", 0x1A23, 0x70, BOTH, byte(TriggerMode, 7))
TRIGGER_OUTPUT: Command[TriggerOutput] = Command("trigger output 1", 0x1A1D, 0x6A, BOTH, fields(TriggerOutput, "3B"))
RUN: Command[Run] = Command("start, pause and stop", 0x1A24, 0x65, BOTH, byte(Run, 3))
TIMING: Command[Timing] = Command("exposure and period", 0x1A29, 0x66, BOTH, fields(Timing, "2I"))
LUT_CONTROL: Command[LutControl] = Command("LUT control", 0x1A31, 0x75, BOTH, codecs.LUT_CONTROL)
MAILBOX_OFFSET: Command[int] = Command("mailbox offset", 0x1A32, 0x76, BOTH, integer(1))
MAILBOX_SELECT: Command[Mailbox] = Command("mailbox select", 0x1A33, 0x77, BOTH, byte(Mailbox, 3))
PATTERN_ENTRIES: Command[tuple[LutEntry, ...]] = Command("mailbox data", 0x1A34, 0x78, WRITE, codecs.ENTRIES)
IMAGE_INDEXES: Command[tuple[int, ...]] = Command("mailbox data", 0x1A34, 0x78, WRITE, codecs.INDEXES)
VALIDATE: Command[Validation] = Command("validate", 0x1A1A, 0x7D, BOTH, byte(Validation))

TABLE: tuple[Command[Any], ...] = (
    HARDWARE_STATUS,
    MAIN_STATUS,
    VERSION,
    FIRMWARE_TAG,
    FLASH_IMAGES,
    POWER,
    DISPLAY_MODE,
    VIDEO_SIGNAL,
    CHANNEL_SWAP,
    INPUT_SOURCE,
    PIXEL_FORMAT,
    TEST_PATTERN,
    TEST_COLOUR,
    GAMMA,
    STILL_IMAGE,
    FLIP_LONG,
    FLIP_SHORT,
    IMAGE_LOAD_RANGE,
    IMAGE_LOAD_TIME,
    LED_ENABLE,
    LED_POLARITY,
    LED_CURRENT,
    PATTERN_SOURCE,
    TRIGGER_MODE,
    TRIGGER_OUTPUT,
    RUN,
    TIMING,
    LUT_CONTROL,
    MAILBOX_OFFSET,
    MAILBOX_SELECT,
    PATTERN_ENTRIES,
    IMAGE_INDEXES,
    VALIDATE,
)
BY_USB: Mapping[tuple[int, Access], Command[Any]] = {
    (command.usb, way): command for command in reversed(TABLE) for way in (READ, WRITE) if way in command.access
}
"""The command of a USB code in one direction; the pattern entries where the mailbox decides what the bytes are."""
BY_REGISTER: Mapping[tuple[int, Access], Command[Any]] = {
    (command.register, way): command for (_, way), command in BY_USB.items() if command.register is not None
}
"""The command of an I2C register in one direction."""
