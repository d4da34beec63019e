"""The controller over USB, by pyusb."""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Iterator
from typing import Any

import usb.backend
import usb.core
import usb.util

from drivers.errors import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceUnavailableError,
    DriverError,
    ProtocolError,
)
from drivers.lightcrafter.commands import NAME, Command
from drivers.lightcrafter.messages import MAXIMUM_PAYLOAD, REPORT_BYTES, Reply, Request, reports_of

VENDOR, PRODUCT = 0x0451, 0x6401
INTERFACE = 0
"""Of the two HID interfaces the one that takes commands."""
_DRAIN_MS = 10
_MOST_STALE_REPORTS = 64
_ERRORS: dict[int | None, tuple[type[DriverError], str]] = {
    errno.EACCES: (
        DevicePermissionError,
        "may not be used by this account; add a udev rule for USB 0451:6401, or install WinUSB for it",
    ),
    errno.EBUSY: (DeviceBusyError, "is held by another program; close TI's GUI"),
}
_ERRORS[errno.EPERM] = _ERRORS[errno.EACCES]


class UsbTransport:
    """Implements Transport. Every write but ``post`` asks for its acknowledgement and reads it.

    path: bus and ports, "1-2.4"; None takes the only controller there is. backend: of pyusb, None for its own choice.
    """

    largest_payload = MAXIMUM_PAYLOAD

    def __init__(
        self, path: str | None = None, *, timeout_s: float = 2.0, backend: usb.backend.IBackend | None = None
    ) -> None:
        self._path = path
        self._timeout_s = timeout_s
        self._backend = backend
        self._device: Any = None
        self._out: Any = None
        self._in: Any = None
        self._driver_detached = False
        self._sequence = 0

    @property
    def location(self) -> str:
        return f"USB {self._path or 'unknown'}" if self._device is None else f"USB {path_of(self._device)}"

    def carries(self, command: Command[Any]) -> bool:
        return True

    def open(self) -> None:
        self.close()
        self._device = self._find()
        try:
            self._claim()
            self._drain()
        except usb.core.USBError as error:
            self.close()
            raise _translated(error, DeviceNotFoundError) from error
        except DriverError:
            self.close()
            raise

    def _find(self) -> Any:
        try:
            found = list(usb.core.find(find_all=True, idVendor=VENDOR, idProduct=PRODUCT, backend=self._backend))
        except usb.core.NoBackendError as error:
            raise DeviceUnavailableError(NAME, "needs libusb 1.0, which is not installed here") from error
        except usb.core.USBError as error:
            raise _translated(error, DeviceNotFoundError) from error
        paths = {path_of(device): device for device in found}
        if self._path is not None:
            if self._path not in paths:
                there = f"there are {', '.join(sorted(paths))}" if paths else "there is none"
                raise DeviceNotFoundError(NAME, f"is not at USB path {self._path}; {there}")
            return paths[self._path]
        if not found:
            raise DeviceNotFoundError(NAME, "is not attached (USB 0451:6401); check its cable and power")
        if len(found) > 1:
            raise DeviceNotFoundError(NAME, f"could be any of {', '.join(sorted(paths))}; name its USB path")
        return found[0]

    def _claim(self) -> None:
        device = self._device
        # not every system knows kernel drivers; where it does not, claiming tells whether one is in the way
        with contextlib.suppress(NotImplementedError):
            if device.is_kernel_driver_active(INTERFACE):
                device.detach_kernel_driver(INTERFACE)
                self._driver_detached = True
        configuration = device.get_active_configuration()
        interface = usb.util.find_descriptor(configuration, bInterfaceNumber=INTERFACE)
        ends = [] if interface is None else list(interface)
        directions = {usb.util.endpoint_direction(end.bEndpointAddress): end for end in reversed(ends)}
        if set(directions) != {usb.util.ENDPOINT_IN, usb.util.ENDPOINT_OUT}:
            raise ProtocolError(NAME, f"has no way in and out at USB interface {INTERFACE}")
        self._in, self._out = directions[usb.util.ENDPOINT_IN], directions[usb.util.ENDPOINT_OUT]
        usb.util.claim_interface(device, INTERFACE)

    def _drain(self) -> None:
        """Answers that an earlier program asked for and did not read."""
        for _ in range(_MOST_STALE_REPORTS):
            try:
                self._in.read(REPORT_BYTES, _DRAIN_MS)
            except usb.core.USBTimeoutError:
                return

    def request(self, command: Command[Any], payload: bytes | None = None) -> bytes:
        return self._exchange(command, payload or b"", read=payload is None)

    def ask(self, command: Command[Any], argument: bytes) -> bytes:
        """A read that says what of: as ``request``."""
        return self._exchange(command, argument, read=True)

    def post(self, command: Command[Any], payload: bytes) -> None:
        """Write what the controller does not acknowledge. DeviceLostError where it does not take it."""
        with self._translating(command):
            self._send(Request(command.usb, self._next_sequence(), payload, acknowledged=False))

    def _exchange(self, command: Command[Any], payload: bytes, *, read: bool) -> bytes:
        with self._translating(command):
            sequence = self._next_sequence()
            self._send(Request(command.usb, sequence, payload, read=read))
            reply = self._reply(sequence)
        if reply.refused or (read and not reply.data):
            raise ProtocolError(NAME, f"refused '{command.name}'")
        return reply.data

    @contextlib.contextmanager
    def _translating(self, command: Command[Any]) -> Iterator[None]:
        if self._device is None:
            raise DeviceLostError(NAME, "is not open")
        try:
            yield
        except usb.core.USBTimeoutError as error:
            raise DeviceLostError(NAME, f"did not answer '{command.name}' within {self._timeout_s:g} s") from error
        except usb.core.USBError as error:
            raise _translated(error, DeviceLostError) from error

    def _next_sequence(self) -> int:
        self._sequence = self._sequence % 255 + 1
        return self._sequence

    def _send(self, request: Request) -> None:
        message = request.encode()
        for start in range(0, len(message), REPORT_BYTES):
            self._out.write(message[start : start + REPORT_BYTES], self._milliseconds(self._timeout_s))

    def _reply(self, sequence: int) -> Reply:
        """The answer with this sequence number; older ones that nobody read are dropped."""
        deadline = time.monotonic() + self._timeout_s
        while True:
            message = bytes(self._in.read(REPORT_BYTES, self._milliseconds(deadline - time.monotonic())))
            for _ in range(1, reports_of(message)):
                message += bytes(self._in.read(REPORT_BYTES, self._milliseconds(deadline - time.monotonic())))
            reply = Reply.decode(message)
            if reply.sequence == sequence:
                return reply

    @staticmethod
    def _milliseconds(seconds: float) -> int:
        """At least 1: for pyusb 0 means to wait for ever."""
        return max(1, round(1000 * seconds))

    def close(self) -> None:
        device, self._device = self._device, None
        if device is None:
            return
        with contextlib.suppress(usb.core.USBError, NotImplementedError):
            usb.util.release_interface(device, INTERFACE)
        if self._driver_detached:
            with contextlib.suppress(usb.core.USBError, NotImplementedError):
                device.attach_kernel_driver(INTERFACE)
        self._driver_detached = False
        with contextlib.suppress(usb.core.USBError):
            usb.util.dispose_resources(device)


def path_of(device: Any) -> str:
    """Bus and ports of a pyusb device, as Linux names them: "1-2.4"."""
    ports = device.port_numbers or ()
    return f"{device.bus}-{'.'.join(map(str, ports))}"


def _translated(error: usb.core.USBError, otherwise: type[DriverError]) -> DriverError:
    kind, text = _ERRORS.get(error.errno, (otherwise, "does not answer on USB; check its cable and power"))
    if kind is otherwise:
        text += f" ({error.strerror or error})"
    return kind(NAME, text)
