"""The way to the controller, whatever the wire."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

from drivers.lightcrafter.commands import Command

T = TypeVar("T")


class Transport(Protocol):
    """Carries commands to one controller. Calls come from one thread at a time."""

    @property
    def location(self) -> str:
        """Where the controller is attached: the bus and the ports, or the serial port."""
        ...

    @property
    def largest_payload(self) -> int:
        """Most bytes that one write may carry."""
        ...

    def carries(self, command: Command[Any]) -> bool:
        """Whether the wire knows the command."""
        ...

    def open(self) -> None:
        """Raises DeviceNotFoundError, DeviceBusyError, DevicePermissionError, DeviceUnavailableError."""
        ...

    def request(self, command: Command[Any], payload: bytes | None = None) -> bytes:
        """Write ``payload``, or read where it is None; the answer's data.

        Raises ProtocolError naming the command where the controller refuses it or answers nonsense, DeviceLostError
        where it does not answer.
        """
        ...

    def close(self) -> None:
        """Let go of the wire. Idempotent; never raises."""
        ...


def read(transport: Transport, command: Command[T]) -> T:
    """The value that the controller holds."""
    return command.decode(transport.request(command))


def write(transport: Transport, command: Command[T], value: T) -> None:
    """Give the controller a value."""
    transport.request(command, command.encode(value))
