"""The controller as an I2C slave behind a USB-serial bridge, by pyserial."""

from __future__ import annotations

import contextlib
import errno
import time
from typing import Any

import serial

from drivers.errors import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DriverError,
    ProtocolError,
)
from drivers.lightcrafter.bridges import Bridge, BridgeError, NotAcknowledgedError
from drivers.lightcrafter.commands import NAME, Command

ADDRESS = 0x1A
"""7-bit address of the controller; 0x1D with the jumper J19."""
_WRITE_BIT = 0x80
READY = 0x01
"""Bit of the status byte that says that an answer follows."""
_ATTEMPTS = 20
_RETRY_S = 0.005
_BUSY = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)


class SerialTransport:
    """Implements Transport.

    port: "/dev/ttyACM0", "COM3". pacing_s: pause after each write, which the controller needs on I2C. ready_mask: bits
    of the byte before each answer of which one must be set.
    """

    def __init__(
        self,
        port: str,
        bridge: Bridge,
        *,
        address: int = ADDRESS,
        timeout_s: float = 0.5,
        pacing_s: float = 0.01,
        ready_mask: int = READY,
    ) -> None:
        self._path = port
        self._bridge = bridge
        self._address = address
        self._timeout_s = timeout_s
        self._pacing_s = pacing_s
        self._ready_mask = ready_mask
        self._port: serial.Serial | None = None

    @property
    def location(self) -> str:
        return f"{self._bridge.name} at {self._path}"

    @property
    def largest_payload(self) -> int:
        return self._bridge.largest_payload

    def carries(self, command: Command[Any]) -> bool:
        return command.register is not None

    def open(self) -> None:
        self.close()
        try:
            self._port = serial.Serial(
                self._path,
                self._bridge.baud,
                timeout=self._timeout_s,
                write_timeout=self._timeout_s,
                exclusive=True,
            )
        except OSError as error:
            raise self._refused(error) from error
        try:
            self._port.read(self._port.in_waiting)
            self._bridge.enter(self._port)
        except (BridgeError, OSError) as error:
            self.close()
            raise DeviceNotFoundError(NAME, f"has no {self._bridge.name} at {self._path}: {_line(error)}") from error

    def _refused(self, error: OSError) -> DriverError:
        if error.errno in (errno.EACCES, errno.EPERM):
            return DevicePermissionError(NAME, f"port {self._path} may not be used; join the group that owns it")
        if error.errno in _BUSY:
            return DeviceBusyError(NAME, f"port {self._path} is held by another program")
        return DeviceNotFoundError(NAME, f"port {self._path} cannot be opened: {_line(error)}")

    def request(self, command: Command[Any], payload: bytes | None = None) -> bytes:
        if self._port is None:
            raise DeviceLostError(NAME, "is not open")
        register = command.register
        if register is None:
            raise ProtocolError(NAME, f"cannot be asked for '{command.name}' over I2C; use USB")
        try:
            if payload is None:
                return self._read(self._port, command, register)
            self._bridge.write(self._port, self._address, register | _WRITE_BIT, payload)
        except NotAcknowledgedError as error:
            if error.present:
                raise ProtocolError(NAME, f"refused '{command.name}'") from error
            text = f"does not answer at I2C address {self._address:#04x}; check its wires and power"
            raise DeviceLostError(NAME, text) from error
        except (BridgeError, OSError) as error:
            raise DeviceLostError(NAME, f"is lost behind its {self._bridge.name}: {_line(error)}") from error
        time.sleep(self._pacing_s)
        return b""

    def _read(self, port: serial.Serial, command: Command[Any], register: int) -> bytes:
        """Before its answer the controller puts a byte that says whether the answer is ready."""
        status = 0
        for _ in range(_ATTEMPTS):
            answer = self._bridge.read(port, self._address, register, 1 + command.read_size)
            status = answer[0]
            if status & self._ready_mask:
                return answer[1:]
            time.sleep(_RETRY_S)
        raise ProtocolError(NAME, f"refused '{command.name}' (I2C status {status:#04x})")

    def close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError, BridgeError):
                self._bridge.leave(port)
            with contextlib.suppress(OSError):
                port.close()


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
