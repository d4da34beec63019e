"""What the controller's commands carry, as values: status words, versions, LUT entries."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

MAXIMUM_ENTRIES = 128
"""Entries of the pattern LUT."""
MAXIMUM_IMAGES = 64
"""Entries of the image LUT: one is used up by each buffer swap."""
FILL_NUMBER = 24
"""Pattern number at 1 bit that shows black, and white when inverted; it takes no image."""


class HardwareStatus(IntFlag):
    """Bits of 1A 0A."""

    INITIALISED = 0x01
    DMD_RESET_ERROR = 0x04
    FORCED_SWAP_ERROR = 0x08
    SEQUENCE_ABORTED = 0x40
    SEQUENCE_ERROR = 0x80


class MainStatus(IntFlag):
    """Bits of 1A 0C."""

    PARKED = 0x01
    RUNNING = 0x02
    FROZEN = 0x04
    GAMMA = 0x08


class Validation(IntFlag):
    """Bits of 1A 1A. Only the first two are errors; bits 2 to 4 are warnings."""

    EXPOSURE_INVALID = 0x01
    PATTERN_INVALID = 0x02
    TRIGGER_CONTINUOUS = 0x04
    BLACK_MISSING = 0x08
    GAP_SHORT = 0x10
    BUSY = 0x80


_HARDWARE_WORDS = {
    HardwareStatus.DMD_RESET_ERROR: "the DMD reset controller failed",
    HardwareStatus.FORCED_SWAP_ERROR: "a buffer swap was forced too early",
    HardwareStatus.SEQUENCE_ABORTED: "the sequencer aborted",
    HardwareStatus.SEQUENCE_ERROR: "the sequencer met an error",
}
_VALIDATION_WORDS = {
    Validation.EXPOSURE_INVALID: "the exposure or the period is out of range",
    Validation.PATTERN_INVALID: "a pattern number is out of range for its bit depth",
    Validation.TRIGGER_CONTINUOUS: "the trigger output stays high between patterns",
    Validation.BLACK_MISSING: "no black stands before an externally triggered pattern",
    Validation.GAP_SHORT: "the dark time after each pattern is below 230 us",
}


def words(status: HardwareStatus | Validation) -> str:
    """The set bits in words, "; " between them; empty where none has any."""
    if isinstance(status, HardwareStatus):
        return "; ".join(text for bit, text in _HARDWARE_WORDS.items() if bit in status)
    return "; ".join(text for bit, text in _VALIDATION_WORDS.items() if bit in status)


class Run(IntEnum):
    """Argument of 1A 24."""

    STOP = 0
    PAUSE = 1
    START = 2


class Power(IntEnum):
    """Argument of 02 00."""

    NORMAL = 0
    STANDBY = 1


class Mode(IntEnum):
    """Argument of 1A 1B."""

    VIDEO = 0
    PATTERN = 1


class Source(IntEnum):
    """Input of the video mode (1A 00, bits 2:0)."""

    PARALLEL = 0
    TEST_PATTERN = 1
    FLASH = 2
    FPD_LINK = 3


class Width(IntEnum):
    """Bits of a pixel of the video mode's input (1A 00, bits 5:3)."""

    BITS_30 = 0
    BITS_24 = 1
    BITS_20 = 2
    BITS_16 = 3
    BITS_10 = 4
    BITS_8 = 5


class Input(NamedTuple):
    """Argument of 1A 00."""

    source: Source
    width: Width = Width.BITS_30


class PixelFormat(IntEnum):
    """Argument of 1A 02."""

    RGB444 = 0
    YCRCB444 = 1
    YCRCB422 = 2


class PatternSource(IntEnum):
    """Argument of 1A 22."""

    VIDEO = 0
    FLASH = 3


class TriggerMode(IntEnum):
    """Argument of 1A 23, the modes that are used here."""

    VSYNC = 0
    INTERNAL = 1


class Mailbox(IntEnum):
    """Argument of 1A 33."""

    CLOSED = 0
    IMAGES = 1
    PATTERNS = 2


class InternalPattern(IntEnum):
    """Argument of 12 03, the one that is used here."""

    SOLID = 0


class Trigger(IntEnum):
    """What starts a LUT entry."""

    INTERNAL = 0
    EXTERNAL_POSITIVE = 1
    EXTERNAL_NEGATIVE = 2
    CONTINUE = 3


class LedSelect(IntFlag):
    """LEDs of a LUT entry."""

    RED = 1
    GREEN = 2
    BLUE = 4
    WHITE = 7


class LedEnable(IntFlag):
    """Bits of 1A 07. SEQUENCER: each LUT entry chooses its LEDs."""

    RED = 1
    GREEN = 2
    BLUE = 4
    SEQUENCER = 8


class Release(NamedTuple):
    """A version of one part of the firmware."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.patch}"


class Versions(NamedTuple):
    """Answer of 02 05."""

    application: Release
    interface: Release
    software: Release
    sequencer: Release


class Timing(NamedTuple):
    """Exposure and period of every pattern, microseconds."""

    exposure_us: int
    period_us: int


class LutControl(NamedTuple):
    """How much of the LUTs is played. All counts from 1. patterns: how many are shown when not repeating."""

    entries: int
    repeat: bool
    patterns: int
    images: int


class Currents(NamedTuple):
    """LED drive bytes as sent; whether 255 is bright or dark depends on the LED board."""

    red: int
    green: int
    blue: int


class InternalColour(NamedTuple):
    """Foreground and background of the test pattern, 0..1023 each."""

    red: int
    green: int
    blue: int
    back_red: int
    back_green: int
    back_blue: int


class TriggerOutput(NamedTuple):
    """Argument of 1A 1D. Delays count steps of 107.2 ns from -20.05 us; 0xBB is none."""

    polarity: int
    rise: int
    fall: int


class VideoSignal(NamedTuple):
    """Answer of 07 1C. status: its low two bits are 2 where the controller has locked to the signal."""

    status: int
    columns: int
    rows: int
    reserved: int
    horizontal_polarity: int
    vertical_polarity: int
    pixel_clock: int
    line_rate: int
    frame_rate: int
    total_pixels: int
    total_lines: int
    active_pixels: int
    active_lines: int
    first_pixel: int
    first_line: int

    @property
    def locked(self) -> bool:
        return self.status & 3 == 2


class ImageRange(NamedTuple):
    """Flash images whose load time is to be measured."""

    first: int
    images: int


@dataclass(frozen=True)
class LutEntry:
    """One pattern of a sequence, 24 bits on the wire.

    number: which bit planes of the image in the buffer, for this depth. black: dark after the pattern. swap: take the
    next image of the image LUT first. share: one trigger pulse and one exposure with the pattern before.
    """

    number: int
    depth: int
    trigger: Trigger = Trigger.INTERNAL
    leds: LedSelect = LedSelect.WHITE
    inverted: bool = False
    black: bool = False
    swap: bool = False
    share: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.number <= 0x3F and 1 <= self.depth <= 8):
            raise ValueError(f"LUT entry: pattern {self.number} of {self.depth} bits is impossible")
