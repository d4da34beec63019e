"""An emulated controller whose flash can be written: it has a bootloader, and may come up in it."""

from __future__ import annotations

import time
from typing import Any

from drivers.lightcrafter.bootloader import ENTER, PROGRAM_MODE
from drivers.lightcrafter.emulator.bootloader import Boot, EmulatedBootloader, NotTakenError, PowerLostError
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError, SilentError


class ProgrammableController(EmulatedController):
    """bootloader: with the flash, from which the images are taken. absent_s: how long a restart takes it off the bus.

    settings: of EmulatedController. A controller that loses its power stays without until ``plug``.
    """

    def __init__(self, bootloader: EmulatedBootloader, *, absent_s: float = 0.0, **settings: Any) -> None:
        self.bootloader = bootloader
        self._absent_s = absent_s
        self._back_at = 0.0
        self._booted = bootloader.boot()
        super().__init__(bootloader.flash(), **settings)

    @property
    def plugged(self) -> bool:
        return self._plugged and time.monotonic() >= self._back_at and self._booted is not Boot.NOTHING

    @property
    def in_bootloader(self) -> bool:
        return self._booted is Boot.BOOTLOADER

    def plug(self) -> None:
        self._restart(self.bootloader.boot())

    def handle(self, code: int, payload: bytes | None, argument: bytes = b"") -> bytes:
        if not self.plugged:
            raise SilentError
        if self.in_bootloader:
            return self._handle_in_bootloader(code, payload, argument)
        if code == PROGRAM_MODE.usb and payload == bytes([ENTER]):
            if self.bootloader.faults.ignored_entries:
                self.bootloader.faults.ignored_entries -= 1
                return b""
            self.unplug()
            self.bootloader.boot()
            self._restart(Boot.BOOTLOADER)
            return b""
        return super().handle(code, payload, argument)

    def _handle_in_bootloader(self, code: int, payload: bytes | None, argument: bytes) -> bytes:
        try:
            data, ends = self.bootloader.handle(code, payload, argument)
        except NotTakenError as error:
            raise (SilentError if self.bootloader.faults.deaf else RefusedError) from error
        except PowerLostError as error:
            self.unplug()
            raise SilentError from error
        if ends:
            self.unplug()
            self._restart(self.bootloader.boot())
        return data

    def _restart(self, booted: Boot) -> None:
        self._booted = booted
        if booted is Boot.PROGRAM:
            self.flash = self.bootloader.flash()
        self._back_at = time.monotonic() + self._absent_s
        self._plugged = True
