"""The bootloader of an emulated controller, and the flash that it writes.

It is as unforgiving as a real one may be: an erase sets bits and a write only clears them, what comes while it is busy
is lost, and a table that stands before the program behind it is whole makes a controller that never answers again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from drivers.lightcrafter import bootloader as b
from drivers.lightcrafter.emulator.faults import BootloaderFaults
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.firmware import FirmwareFile
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES, SIGNATURE

_ANSWER_BYTES = 16
_STATUS = b.STATUS.usb


class PowerLostError(Exception):
    """The power went in the midst of a command."""


class NotTakenError(Exception):
    """The bootloader does not accept the command."""


class Boot(Enum):
    """What comes up with the power."""

    PROGRAM = "program"
    BOOTLOADER = "bootloader"
    NOTHING = "nothing"


@dataclass(frozen=True)
class Touch:
    """An erase or a write of so many bytes from ``start``."""

    kind: Literal["erase", "write"]
    start: int
    size: int


class EmulatedBootloader:
    """memory: the flash, as long as the firmware or longer. log: every erase and write, in their order.
    commands: how many came, those that were not taken among them.
    """

    def __init__(self, firmware: bytes, *, size: int = 0x200000, erase_s: float = 0.0, sum_s: float = 0.0) -> None:
        self.faults = BootloaderFaults()
        self.memory = bytearray(firmware.ljust(size, b"\xff"))
        self.log: list[Touch] = []
        self.commands = 0
        self._erase_s, self._sum_s = erase_s, sum_s
        self._incomplete: set[int] = set()
        self._power_up()

    def _power_up(self) -> None:
        self._address = 0
        self._size = 0
        self._left = 0
        self._type: int | None = None
        self._sum = 0
        self._busy_until = 0.0

    def boot(self) -> Boot:
        """What a controller with this flash does when its power comes."""
        self._power_up()
        if self.memory[BOOTLOADER_BYTES : BOOTLOADER_BYTES + 4] != SIGNATURE:
            return Boot.BOOTLOADER
        return Boot.NOTHING if self._incomplete else Boot.PROGRAM

    def flash(self) -> EmulatedFlash:
        """The images that the program finds."""
        firmware = FirmwareFile.parse(bytes(self.memory))
        return EmulatedFlash([firmware.image(k) for k in range(len(firmware.blobs))])

    def handle(self, code: int, payload: bytes | None, argument: bytes) -> tuple[bytes, bool]:
        """Carry out one command: its answer, and whether the bootloader ends.

        Raises NotTakenError, and PowerLostError where the faults say that the power goes now.
        """
        self.commands += 1
        failing = self._power_fails()
        if payload is None:
            if code != _STATUS or failing:
                raise PowerLostError if failing else NotTakenError
            return self._status(argument), False
        if time.monotonic() < self._busy_until or self.faults.stuck:
            raise PowerLostError if failing else NotTakenError
        ends = self._write(code, payload, failing)
        if failing:
            raise PowerLostError
        return b"", ends

    def _power_fails(self) -> bool:
        if self.faults.power_lost_after is None:
            return False
        self.faults.power_lost_after -= 1
        if self.faults.power_lost_after >= 0:
            return False
        self.faults.power_lost_after = None
        return True

    def _status(self, argument: bytes) -> bytes:
        busy = time.monotonic() < self._busy_until or self.faults.stuck
        answer = bytearray(_ANSWER_BYTES)
        answer[0] = b.BUSY * busy
        value = {
            b.ASK_MANUFACTURER: self.faults.manufacturer,
            b.ASK_DEVICE: 0x2221 << 16 | 0x227E,
        }.get(argument[0] if argument else 0, self._sum)
        answer[b.VALUE_AT : b.VALUE_AT + 4] = value.to_bytes(4, "little")
        return bytes(answer)

    def _write(self, code: int, payload: bytes, failing: bool) -> bool:
        if code == b.FLASH_TYPE.usb:
            self._type = payload[0]
        elif code == b.ADDRESS.usb:
            self._address = b.ADDRESS.decode(payload)
        elif code == b.SIZE.usb:
            self._size = self._left = b.SIZE.decode(payload)
        elif code == b.ERASE.usb:
            self._erase(b.SECTOR_BYTES // 2 if failing else b.SECTOR_BYTES)
        elif code == b.DATA.usb:
            self._program(payload[: len(payload) // 2] if failing else payload)
        elif code == b.CHECKSUM.usb:
            self._compute()
        elif code == b.EXIT.usb and payload[0] == b.LEAVE:
            return True
        else:
            raise NotTakenError
        return False

    def _erase(self, size: int) -> None:
        if self._type is None or self._address % b.SECTOR_BYTES:
            raise NotTakenError
        self.log.append(Touch("erase", self._address, size))
        self.memory[self._address : self._address + size] = b"\xff" * size
        self._incomplete.add(self._address)
        self._busy_until = time.monotonic() + self._erase_s

    def _program(self, data: bytes) -> None:
        """Bytes beyond the announced size are lost, as are those of messages that are too long."""
        start = self._address + self._size - self._left
        data = data[: min(self._left, b.LARGEST_DATA)]
        self.log.append(Touch("write", start, len(data)))
        old = self.memory[start : start + len(data)]
        self.memory[start : start + len(data)] = bytes(o & n for o, n in zip(old, data, strict=True))
        self._left -= len(data)
        if not self._left and self._size > len(SIGNATURE):
            self._incomplete.discard(start // b.SECTOR_BYTES * b.SECTOR_BYTES)

    def _compute(self) -> None:
        self._sum = sum(self.memory[self._address : self._address + self._size]) % (1 << 32)
        if self.faults.wrong_sums:
            self.faults.wrong_sums -= 1
            self._sum ^= 1
        self._busy_until = time.monotonic() + self._sum_s
