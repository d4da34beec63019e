"""A controller with a graphics card at its video input."""

from __future__ import annotations

from typing import Any

import numpy as np
from lightcrafter_benches import controller, quick, usb_transport

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.transport import Transport
from drivers.lightcrafter.values import (
    Mode,
)
from drivers.lightcrafter.video import opened


class Listening:
    """A transport that keeps what is written."""

    def __init__(self, inner: Transport) -> None:
        self._inner = inner
        self.largest_payload = inner.largest_payload
        self.location = inner.location
        self.written: list[tuple[Command[Any], bytes]] = []

    def carries(self, command: Command[Any]) -> bool:
        return self._inner.carries(command)

    def open(self) -> None:
        self._inner.open()

    def close(self) -> None:
        self._inner.close()

    def request(self, command: Command[Any], payload: bytes | None = None) -> bytes:
        if payload is not None:
            self.written.append((command, payload))
        return self._inner.request(command, payload)

    def payloads(self, command: Command[Any]) -> list[bytes]:
        return [payload for written, payload in self.written if written is command]


def connected(**settings: Any) -> EmulatedController:
    """A controller whose video input gets what it needs."""
    device = controller(**settings)
    device.video.connect()
    device.video.lock_s = 0.01
    return device


def on_usb(device: EmulatedController) -> Any:
    return opened(usb_transport(device)[0], quick())


def holds(device: EmulatedController, command: Command[Any]) -> Any:
    return command.decode(device.handle(command.usb, None))


def assert_dark(device: EmulatedController) -> None:
    assert not device.running
    assert holds(device, c.DISPLAY_MODE) is Mode.PATTERN
    assert not device.light().any()


def drawn(rows: int = 1140, columns: int = 912) -> np.ndarray:
    return np.random.default_rng(4).integers(0, 256, (rows, columns, 3), np.uint8)
