"""The emulated controller with the faults of a bench: some strike once, in the middle of a procedure."""

from __future__ import annotations

from typing import Any

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError, SilentError
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.values import Run
from drivers.virtual.faults import Faults

_START = bytes([Run.START])


class FaultyController(EmulatedController):
    """faults: "start_refused" and "unplugged" are this device's. Other arguments are those of EmulatedController."""

    def __init__(self, flash: EmulatedFlash, faults: Faults, **settings: Any) -> None:
        super().__init__(flash, **settings)
        self._planted = faults

    def handle(self, code: int, payload: bytes | None, argument: bytes = b"") -> bytes:
        starts = code == c.RUN.usb and payload == _START
        loads = code == c.LUT_CONTROL.usb and payload is not None
        if starts and self._planted.spend("start_refused"):
            raise RefusedError
        if (starts or loads) and self._planted.spend("unplugged"):
            self.unplug()
            self.plug()
            raise SilentError
        return super().handle(code, payload, argument)
