"""The controller's bootloader over USB: what it is told, one step at a time.

Addresses count from the beginning of the flash. The first 0x20000 bytes hold the bootloader itself: no call here
erases or writes them. Source: the code of the GUI that TI publishes; none of it was tried on a projector.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.errors import DeviceLostError, DriverError, ProtocolError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.codecs import Codec, integer
from drivers.lightcrafter.commands import NAME, Access, Command
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES
from drivers.lightcrafter.messages import MAXIMUM_PAYLOAD
from drivers.lightcrafter.usb import UsbTransport
from drivers.lightcrafter.values import Versions
from models.errors import DuofringeError

_WRITE, _READ = Access.WRITE, Access.READ
_RAW: Codec[bytes] = Codec(None, bytes, bytes)
_NOTHING: Codec[bytes] = Codec(0, bytes, bytes)

PROGRAM_MODE: Command[int] = Command("program mode", 0x3001, None, _WRITE, integer(1))
STATUS: Command[bytes] = Command("bootloader status", 0x0015, None, _READ, _RAW)
FLASH_TYPE: Command[int] = Command("flash type", 0x002F, None, _WRITE, integer(1))
ADDRESS: Command[int] = Command("flash address", 0x0029, None, _WRITE, integer(4))
ERASE: Command[bytes] = Command("sector erase", 0x0028, None, _WRITE, _NOTHING)
SIZE: Command[int] = Command("download size", 0x002C, None, _WRITE, integer(4))
DATA: Command[bytes] = Command("download data", 0x0025, None, _WRITE, _RAW)
CHECKSUM: Command[bytes] = Command("flash checksum", 0x0026, None, _WRITE, _NOTHING)
EXIT: Command[int] = Command("end of the bootloader", 0x0030, None, _WRITE, integer(1))

BUSY = 0x08
"""Bit of the first byte of every status."""
ASK_SUM, ASK_MANUFACTURER, ASK_DEVICE = 0x00, 0x0C, 0x0D
"""What a status is asked for; its answer begins at byte 6."""
VALUE_AT = 6
ENTER, LEAVE = 1, 2
LARGEST_DATA: Final = MAXIMUM_PAYLOAD - 2
"""The bootloader loses bytes of longer messages, says TI's code."""
SECTOR_BYTES = 0x20000
_LONGEST_MESSAGE_REPORTS = 8


@dataclass(frozen=True)
class FlashPart:
    """A flash chip whose sectors are known. algorithm: its number with the bootloader."""

    name: str
    algorithm: int
    size: int


KNOWN_PARTS = {(0x0020, 0x227E): FlashPart("M29DW128G", 0, 0x2000000)}
"""By manufacturer and low word of the device id; sectors of 128 KiB. Others are refused: with other sectors an erase
could reach the bootloader."""


class FlashError(DuofringeError):
    """The projector's flash cannot be written, or was not written rightly."""


@dataclass(frozen=True)
class BootloaderTimes:
    """Seconds. busy_s: longest time of an erase or a checksum. return_s: until the controller is back on the bus.
    enter_again_s: until a controller that stays in its normal mode is asked again. pause_s: between two looks."""

    busy_s: float = 60.0
    return_s: float = 30.0
    enter_again_s: float = 5.0
    pause_s: float = 0.05


class Bootloader:
    """The bootloader behind an open transport. Every call raises DeviceLostError and ProtocolError as the transport."""

    def __init__(self, transport: UsbTransport, times: BootloaderTimes) -> None:
        self._transport = transport
        self._times = times

    def identify(self) -> FlashPart:
        """Raises FlashError for a flash whose sectors are not known."""
        ids = (self._value(ASK_MANUFACTURER, 2), self._value(ASK_DEVICE, 4) & 0xFFFF)
        if ids not in KNOWN_PARTS:
            raise FlashError(
                f"the projector's flash chip (manufacturer 0x{ids[0]:04X}, device 0x{ids[1]:04X}) is not known here; "
                "nothing was erased; write the firmware with TI's GUI"
            )
        return KNOWN_PARTS[ids]

    def select(self, part: FlashPart) -> None:
        self._transport.request(FLASH_TYPE, FLASH_TYPE.encode(part.algorithm))

    def erase(self, address: int) -> None:
        """Erase the sector that begins there."""
        _guard(address, SECTOR_BYTES)
        self._transport.request(ADDRESS, ADDRESS.encode(address))
        self._transport.request(ERASE, b"")
        self._wait("erase a sector")

    def write(self, address: int, data: bytes, check: Callable[[int], None] = lambda written: None) -> None:
        """Write into an erased sector. check: called with the bytes sent so far; may raise to stop."""
        _guard(address, len(data))
        self._transport.request(ADDRESS, ADDRESS.encode(address))
        self._transport.request(SIZE, SIZE.encode(len(data)))
        for start in range(0, len(data), LARGEST_DATA):
            check(start)
            self._transport.post(DATA, data[start : start + LARGEST_DATA])
        self._wait("write a sector")

    def checksum(self, address: int, size: int) -> int:
        """Sum of the bytes, modulo 2^32, as the controller reads its flash."""
        self._transport.request(ADDRESS, ADDRESS.encode(address))
        self._transport.request(SIZE, SIZE.encode(size))
        self._transport.post(CHECKSUM, b"")
        self._wait("compute a checksum")
        return self._value(ASK_SUM, 4)

    def leave(self) -> None:
        """Start the program that the flash holds. The controller leaves the bus for some seconds."""
        self._transport.post(EXIT, EXIT.encode(LEAVE))

    def _value(self, wanted: int, size: int) -> int:
        answer = self._transport.ask(STATUS, bytes([wanted]))
        if len(answer) < VALUE_AT + size:
            raise ProtocolError(NAME, f"answered nonsense to '{STATUS.name}': {len(answer)} bytes")
        return int.from_bytes(answer[VALUE_AT : VALUE_AT + size], "little")

    def _wait(self, work: str) -> None:
        deadline = time.monotonic() + self._times.busy_s
        while self._transport.ask(STATUS, bytes([ASK_SUM]))[0] & BUSY:
            if time.monotonic() > deadline:
                raise FlashError(
                    f"the projector takes longer than {self._times.busy_s:g} s to {work}; switch it off and on, then "
                    "run the same command again"
                )
            time.sleep(self._times.pause_s)


def _guard(address: int, size: int) -> None:
    """Nothing below the end of the bootloader and nothing across sectors, whatever the callers believe."""
    if address < BOOTLOADER_BYTES or size <= 0 or address % SECTOR_BYTES + size > SECTOR_BYTES:
        raise FlashError(f"refusing to touch {size} bytes of the flash at 0x{address:X}; nothing was sent")


def running_version(transport: UsbTransport) -> Versions | None:
    """The firmware's versions, or None where the controller is in its bootloader. The transport is open.

    A program that died within a message leaves the bootloader waiting for the rest of it: questions are repeated until
    they cannot be part of that any more.
    """
    try:
        return c.VERSION.decode(transport.request(c.VERSION))
    except (ProtocolError, DeviceLostError) as error:
        first = error
    for _ in range(_LONGEST_MESSAGE_REPORTS):
        try:
            transport.ask(STATUS, bytes([ASK_SUM]))
        except DriverError:
            continue
        return None
    raise DeviceLostError(NAME, "answers neither as a projector nor as a bootloader; switch it off and on") from first


def enter(transport: UsbTransport, times: BootloaderTimes) -> None:
    """From the normal mode into the bootloader. Raises DeviceLostError where it does not get there."""
    deadline = time.monotonic() + times.return_s
    asked_at = -times.enter_again_s
    while time.monotonic() < deadline:
        try:
            transport.open()
            if running_version(transport) is None:
                return
            if time.monotonic() - asked_at > times.enter_again_s:
                transport.post(PROGRAM_MODE, PROGRAM_MODE.encode(ENTER))
                asked_at = time.monotonic()
        except DriverError:
            pass  # on its way
        transport.close()
        time.sleep(times.pause_s)
    raise DeviceLostError(NAME, f"did not come back as a bootloader within {times.return_s:g} s; run this again")


def wait_for_program(transport: UsbTransport, times: BootloaderTimes) -> Versions:
    """The versions of the firmware that runs after ``leave``. Raises DeviceLostError where none does."""
    deadline = time.monotonic() + times.return_s
    transport.close()
    while time.monotonic() < deadline:
        try:
            transport.open()
            versions = running_version(transport)
            if versions is not None:
                return versions
        except DriverError:
            pass  # on its way
        transport.close()
        time.sleep(times.pause_s)
    raise DeviceLostError(
        NAME, f"did not come back within {times.return_s:g} s after its flash was written; switch it off and on"
    )
