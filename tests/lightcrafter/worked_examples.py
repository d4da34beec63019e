"""Every exchange that the sheet of the controller spells out: request and reply in hex, `ss` = 0x2a.

A reply that the sheet leaves open ("ack") is written with the flags and the length that are most likely; the parser
reads neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.values import (
    Currents,
    HardwareStatus,
    LutControl,
    LutEntry,
    Mailbox,
    MainStatus,
    Mode,
    Release,
    Run,
    Timing,
    Trigger,
    Validation,
    Versions,
)

SEQUENCE = 0x2A
ACK = "40 ss 00 00"


@dataclass(frozen=True)
class Example:
    """value: what is written, or what is read back where ``read``."""

    number: str
    command: Command[Any]
    value: Any
    request: str
    reply: str = ACK
    read: bool = False

    @property
    def request_bytes(self) -> bytes:
        return unhex(self.request)

    @property
    def reply_bytes(self) -> bytes:
        return unhex(self.reply)


def unhex(text: str) -> bytes:
    """Bytes of one report, zero-padded."""
    return bytes.fromhex(text.replace("ss", f"{SEQUENCE:02x}")).ljust(64, b"\0")


_R440, _R310, _R200 = Release(4, 4, 0), Release(3, 1, 0), Release(2, 0, 7)
_THREE = (
    LutEntry(0, 8, black=False, swap=True),
    LutEntry(1, 8),
    LutEntry(2, 8),
)
_VIDEO = (
    LutEntry(0, 8, Trigger.EXTERNAL_POSITIVE, swap=True),
    LutEntry(1, 8, Trigger.CONTINUE),
    LutEntry(2, 8, Trigger.CONTINUE),
)
EXAMPLES = (
    Example("1", c.HARDWARE_STATUS, HardwareStatus.INITIALISED, "C0 ss 02 00 0A 1A", "C0 ss 01 00 01", True),
    Example("2", c.MAIN_STATUS, MainStatus.RUNNING, "C0 ss 02 00 0C 1A", "C0 ss 01 00 02", True),
    Example(
        "3",
        c.VERSION,
        Versions(_R440, _R310, _R200, Release(0, 0, 1)),
        "C0 ss 02 00 05 02",
        "C0 ss 10 00 00 00 04 04 00 00 01 03 07 00 00 02 01 00 00 00",
        True,
    ),
    Example("4", c.RUN, Run.STOP, "40 ss 03 00 24 1A 00"),
    Example("5", c.DISPLAY_MODE, Mode.PATTERN, "40 ss 03 00 1B 1A 01"),
    Example("6", c.TIMING, Timing(8333, 8333), "40 ss 0A 00 29 1A 8D 20 00 00 8D 20 00 00"),
    Example("7", c.TIMING, Timing(10_000, 16_667), "40 ss 0A 00 29 1A 10 27 00 00 1B 41 00 00"),
    Example("8", c.LUT_CONTROL, LutControl(3, False, 3, 1), "40 ss 06 00 31 1A 02 00 02 00"),
    Example("9 open", c.MAILBOX_SELECT, Mailbox.PATTERNS, "40 ss 03 00 33 1A 02"),
    Example("9 offset", c.MAILBOX_OFFSET, 0, "40 ss 03 00 32 1A 00"),
    Example("9 close", c.MAILBOX_SELECT, Mailbox.CLOSED, "40 ss 03 00 33 1A 00"),
    Example("10", c.PATTERN_ENTRIES, _THREE, "40 ss 0B 00 34 1A 00 78 04 04 78 00 08 78 00"),
    Example("11", c.PATTERN_ENTRIES, _VIDEO, "40 ss 0B 00 34 1A 01 78 04 07 78 00 0B 78 00"),
    Example("12 start", c.VALIDATE, Validation(0), "40 ss 03 00 1A 1A 00"),
    Example("12 busy", c.VALIDATE, Validation.BUSY, "C0 ss 02 00 1A 1A", "C0 ss 01 00 80", True),
    Example("12 done", c.VALIDATE, Validation(0), "C0 ss 02 00 1A 1A", "C0 ss 01 00 00", True),
    Example("13", c.LED_CURRENT, Currents(255 - 151, 255 - 120, 255 - 125), "40 ss 05 00 01 0B 68 87 82"),
    Example("14", c.RUN, Run.START, "40 ss 03 00 24 1A 02"),
)
