"""USB-serial bridges to I2C, as protocols of bytes on an open port.

Sources: Devantech's USB-ISS I2C manual; the Bus Pirate's documentation of its binary modes.
"""

from __future__ import annotations

from typing import Protocol

_ISS_MODULE = 0x07
_ISS_HARDWARE_100_KHZ = 0x60
_ISS_SPARE_PINS = 0x04
_ISS_LARGEST = 60
_PIRATE_BULK = 16
_PIRATE_ATTEMPTS = 20
_PIRATE_100_KHZ = 0x62


class BridgeError(Exception):
    """The bridge itself answered nonsense or not at all."""


class NotAcknowledgedError(Exception):
    """Nobody on the bus took a byte. present: whether the controller took its address."""

    def __init__(self, present: bool) -> None:
        super().__init__("present" if present else "absent")
        self.present = present


class Port(Protocol):
    """What a bridge needs of a serial port. ``read`` returns fewer bytes where they do not come in time."""

    def write(self, data: bytes) -> object: ...

    def read(self, size: int) -> bytes: ...


class Bridge(Protocol):
    """An I2C master. address: 7 bits. All calls raise BridgeError and OSError; transfers also NotAcknowledgedError."""

    name: str
    baud: int
    largest_payload: int

    def enter(self, port: Port) -> None:
        """Make the bridge an I2C master of 100 kHz."""
        ...

    def write(self, port: Port, address: int, register: int, data: bytes) -> None: ...

    def read(self, port: Port, address: int, register: int, size: int) -> bytes: ...

    def leave(self, port: Port) -> None:
        """Put the bridge back as it was found."""
        ...


class UsbIss:
    """Devantech USB-ISS. Each command goes out in one write: a gap resets its parser."""

    name = "USB-ISS"
    baud = 9600
    largest_payload = _ISS_LARGEST

    def enter(self, port: Port) -> None:
        module = _ask(port, b"\x5a\x01", 3, self.name)[0]
        if module != _ISS_MODULE:
            raise BridgeError(f"is no USB-ISS (module {module:#04x})")
        answer = _ask(port, bytes([0x5A, 0x02, _ISS_HARDWARE_100_KHZ, _ISS_SPARE_PINS]), 2, self.name)
        if answer[0] != 0xFF:
            raise BridgeError(f"refused the I2C mode (error {answer[1]:#04x})")

    def write(self, port: Port, address: int, register: int, data: bytes) -> None:
        message = bytes([0x55, address << 1, register, len(data)]) + data
        if _ask(port, message, 1, self.name)[0] == 0:
            raise NotAcknowledgedError(self._is_present(port, address))

    def read(self, port: Port, address: int, register: int, size: int) -> bytes:
        # a read says nothing of a missing acknowledgement, so the address is asked for first
        if not self._is_present(port, address):
            raise NotAcknowledgedError(present=False)
        return _ask(port, bytes([0x55, address << 1 | 1, register, size]), size, self.name)

    def _is_present(self, port: Port, address: int) -> bool:
        return _ask(port, bytes([0x58, address << 1]), 1, self.name)[0] != 0

    def leave(self, port: Port) -> None:
        """It has no other state."""


class BusPirate:
    """Bus Pirate v3 in binary I2C mode. pull_ups: of its own, which need a voltage on its Vpu pin."""

    name = "Bus Pirate"
    baud = 115_200
    largest_payload = _ISS_LARGEST

    def __init__(self, *, pull_ups: bool = False) -> None:
        self._pull_ups = pull_ups

    def enter(self, port: Port) -> None:
        for _ in range(_PIRATE_ATTEMPTS):
            port.write(b"\x00")
            if port.read(5) == b"BBIO1":
                break
        else:
            raise BridgeError("does not enter the binary mode of a Bus Pirate")
        if _ask(port, b"\x02", 4, self.name) != b"I2C1":
            raise BridgeError("does not enter its I2C mode")
        self._command(port, _PIRATE_100_KHZ)
        self._command(port, 0x40 | 0x04 * self._pull_ups)

    def write(self, port: Port, address: int, register: int, data: bytes) -> None:
        self._command(port, 0x02)
        try:
            self._send(port, bytes([address << 1, register]) + data)
        finally:
            self._command(port, 0x03)

    def read(self, port: Port, address: int, register: int, size: int) -> bytes:
        self._command(port, 0x02)
        try:
            self._send(port, bytes([address << 1, register]))
            self._command(port, 0x02)
            self._send(port, bytes([address << 1 | 1]))
            data = b""
            for index in range(size):
                data += _ask(port, b"\x04", 1, self.name)
                self._command(port, 0x06 if index < size - 1 else 0x07)
            return data
        finally:
            self._command(port, 0x03)

    def _send(self, port: Port, data: bytes) -> None:
        for start in range(0, len(data), _PIRATE_BULK):
            chunk = data[start : start + _PIRATE_BULK]
            answer = _ask(port, bytes([0x10 | len(chunk) - 1]) + chunk, 1 + len(chunk), self.name)
            if answer[0] != 0x01:
                raise BridgeError(f"answered {answer[0]:#04x} to a write")
            if any(answer[1:]):
                raise NotAcknowledgedError(present=start > 0 or answer[1] == 0)

    def _command(self, port: Port, code: int) -> None:
        answer = _ask(port, bytes([code]), 1, self.name)
        if answer != b"\x01":
            raise BridgeError(f"answered {answer.hex()} to command {code:#04x}")

    def leave(self, port: Port) -> None:
        port.write(b"\x00")
        port.read(5)
        port.write(b"\x0f")
        port.read(1)


def _ask(port: Port, message: bytes, size: int, name: str) -> bytes:
    port.write(message)
    answer = port.read(size)
    if len(answer) < size:
        raise BridgeError(f"{name} answered {len(answer)} of {size} bytes")
    return answer
