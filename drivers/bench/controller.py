"""The emulated controller with the faults of a bench: some strike once, in the middle of a procedure."""

from __future__ import annotations

from typing import Any

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError, SilentError
from drivers.lightcrafter.emulator.faults import EmulatedFaults
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.values import Power, Run
from drivers.virtual.faults import Faults

_START = bytes([Run.START])


class FaultyController(EmulatedController):
    """faults: "start_refused" and "unplugged" are this device's. Other arguments are those of EmulatedController."""

    def __init__(self, flash: EmulatedFlash, faults: Faults, **settings: Any) -> None:
        super().__init__(flash, **settings)
        self._planted = faults

    def mend(self) -> None:
        """Do everything right again, awake."""
        self.faults = EmulatedFaults()
        if self.sleeping:
            self.unplug()
            self.plug()

    @property
    def sleeping(self) -> bool:
        """Whether it is in standby."""
        return self._power is Power.STANDBY

    def sleep(self) -> None:
        """As if somebody else had sent it to standby; ValueError where it has no power."""
        if not self.plugged:
            raise ValueError("the projector is unplugged")
        self._power = Power.STANDBY

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
