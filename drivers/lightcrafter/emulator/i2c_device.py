"""The emulated controller as an I2C slave, and the two bridges that lead to it, as parsers of serial bytes."""

from __future__ import annotations

from typing import Protocol

from drivers.lightcrafter.commands import BY_REGISTER, READ, WRITE
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError, SilentError
from drivers.lightcrafter.serial import ADDRESS

_WRITE_BIT, _READY = 0x80, 0x01


class I2cSlave:
    """What the controller makes of the bytes between a start and a stop."""

    def __init__(self, controller: EmulatedController) -> None:
        self._controller = controller
        self._busy = controller.faults.busy_reads

    def answers(self, address: int) -> bool:
        """Whether it acknowledges its address (8 bits; the lowest says read)."""
        return self._controller.plugged and address >> 1 == ADDRESS

    def write(self, data: bytes) -> bool:
        """A register with its write bit, and a payload; whether the last byte is acknowledged."""
        command = BY_REGISTER.get((data[0] & ~_WRITE_BIT, WRITE))
        if command is None:
            return False
        try:
            self._controller.handle(command.usb, data[1:])
        except RefusedError:
            return False
        except SilentError:
            return True
        return True

    def read(self, register: int, size: int) -> bytes:
        """A byte that says whether the answer is ready, and the answer, padded."""
        command = BY_REGISTER.get((register, READ))
        not_ready = bytes(size)
        if command is None:
            return not_ready
        if self._busy > 0:
            self._busy -= 1
            return not_ready
        try:
            answer = self._controller.handle(command.usb, None)
        except (RefusedError, SilentError):
            return not_ready
        self._busy = self._controller.faults.busy_reads
        return (bytes([_READY]) + answer).ljust(size, b"\xff")[:size]


class EmulatedBridge(Protocol):
    """A bridge on a serial port."""

    def feed(self, data: bytes) -> bytes:
        """What it answers to bytes that came in one write."""
        ...


class EmulatedUsbIss:
    """A USB-ISS. module: the number that it reports of itself."""

    def __init__(self, slave: I2cSlave, *, module: int = 0x07) -> None:
        self._slave = slave
        self._module = module
        self._i2c = False

    def feed(self, data: bytes) -> bytes:
        if data == b"\x5a\x01":
            return bytes([self._module, 0x08, 0x40])
        if len(data) == 4 and data[:2] == b"\x5a\x02":
            self._i2c = data[2] in (0x60, 0x70, 0x80)
            return b"\xff\x00" if self._i2c else b"\x00\x07"
        if not self._i2c:
            return b"\x00\x05"
        if len(data) == 2 and data[0] == 0x58:
            return bytes([self._slave.answers(data[1])])
        if len(data) >= 4 and data[0] == 0x55:
            return self._transfer(data[1], data[2], data[3], data[4:])
        return b""

    def _transfer(self, address: int, register: int, size: int, payload: bytes) -> bytes:
        if size > 60:
            return b"\x00"
        if address & 1:
            return self._slave.read(register, size) if self._slave.answers(address) else b"\xff" * size
        if len(payload) != size:
            return b"\x00"
        return bytes([self._slave.answers(address) and self._slave.write(bytes([register]) + payload)])


class EmulatedBusPirate:
    """A Bus Pirate v3. zeros: how many it takes to enter its binary mode; more than one after a terminal was open."""

    def __init__(self, slave: I2cSlave, *, zeros: int = 1) -> None:
        self._slave = slave
        self._zeros_wanted = zeros
        self._zeros = 0
        self._mode = "terminal"
        self._bulk = b""
        self._written = b""
        self._reading = b""
        self._register = 0
        self._driven = False

    def feed(self, data: bytes) -> bytes:
        answer = b""
        for byte in data:
            answer += self._take(byte)
        return answer

    def _take(self, byte: int) -> bytes:
        if self._mode == "terminal":
            self._zeros = self._zeros + 1 if byte == 0 else 0
            if self._zeros < self._zeros_wanted:
                return b""
            self._mode = "binary"
            return b"BBIO1"
        if self._mode == "binary":
            return self._take_binary(byte)
        if self._bulk:
            return self._take_bulk(byte)
        return self._take_i2c(byte)

    def _take_binary(self, byte: int) -> bytes:
        if byte == 0x02:
            self._mode = "i2c"
            return b"I2C1"
        if byte == 0x0F:
            self._mode, self._zeros = "terminal", 0
            return b"\x01"
        return b"BBIO1" if byte == 0 else b"\x00"

    def _take_bulk(self, byte: int) -> bytes:
        self._bulk += bytes([byte])
        wanted = (self._bulk[0] & 0x0F) + 1
        if len(self._bulk) <= wanted:
            return b""
        sent, self._bulk = self._bulk[1:], b""
        return b"\x01" + bytes(0 if self._hears(b) else 1 for b in sent)

    def _hears(self, byte: int) -> bool:
        """Collects one transfer; what is written is carried out at the stop, except that the command is known now."""
        if not self._written:
            if not self._slave.answers(byte):
                return False
            if byte & 1:
                self._reading = self._slave.read(self._register, 61)
        self._written += bytes([byte])
        if len(self._written) == 2 and not byte & _WRITE_BIT:
            self._register = byte
        return len(self._written) != 2 or not byte & _WRITE_BIT or (byte & 0x7F, WRITE) in BY_REGISTER

    def _take_i2c(self, byte: int) -> bytes:
        if byte == 0x00:
            self._mode = "binary"
            return b"BBIO1"
        if byte >> 4 == 1:
            self._bulk = bytes([byte])
            return b""
        if byte == 0x04:
            got, self._reading = self._reading[:1] or b"\xff", self._reading[1:]
            return got
        if byte == 0x06:
            self._driven = True
        if byte == 0x07:
            self._driven, self._reading = False, b""
        if byte in (0x02, 0x03):
            if self._driven:  # the slave was told to go on and holds the line
                return b"\x00"
            self._finish()
        return b"\x01"

    def _finish(self) -> None:
        if len(self._written) > 1 and self._written[1] & _WRITE_BIT and not self._written[0] & 1:
            self._slave.write(self._written[1:])
        self._written = b""
