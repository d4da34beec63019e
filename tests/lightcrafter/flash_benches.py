"""Emulated controllers with a flash to write, over real pyusb."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from firmware_files import firmware

from drivers.lightcrafter.bootloader import SECTOR_BYTES, BootloaderTimes, enter
from drivers.lightcrafter.emulator.bootloader import EmulatedBootloader
from drivers.lightcrafter.emulator.programmable import ProgrammableController
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES
from drivers.lightcrafter.upload import UploadOutcome, upload
from drivers.lightcrafter.usb import UsbTransport

SPLASH_AT = 0x4F000
"""In the second of the sectors that are written; the images go on in the third."""
OLD = firmware(SPLASH_AT, 2, seed=1)
NEW = firmware(SPLASH_AT, 8, seed=1)
OTHER = firmware(SPLASH_AT, 7, seed=50)
"""Another program and other images."""
QUICK = BootloaderTimes(busy_s=2.0, return_s=1.5, enter_again_s=0.2, pause_s=0.001)


@dataclass
class FlashBench:
    """A controller with a flash, its USB, and a firmware file to write. Nothing may touch the bootloader."""

    file: Path
    content: bytes = NEW
    absent_s: float = 0.0
    erase_s: float = 0.0
    sum_s: float = 0.0
    bootloader: EmulatedBootloader = field(init=False)
    device: ProgrammableController = field(init=False)
    bus: EmulatedUsb = field(init=False)

    def __post_init__(self) -> None:
        self.bootloader = EmulatedBootloader(OLD, size=0x80000, erase_s=self.erase_s, sum_s=self.sum_s)
        self.device = ProgrammableController(self.bootloader, absent_s=self.absent_s)
        self.bus = EmulatedUsb(self.device)
        self.file.write_bytes(self.content)

    def transport(self, timeout_s: float = 0.2) -> UsbTransport:
        return UsbTransport(timeout_s=timeout_s, backend=self.bus)

    def wait_in_bootloader(self) -> None:
        """As after an upload that was cut off before it erased anything."""
        transport = self.transport()
        enter(transport, QUICK)
        transport.close()

    def upload(self, times: BootloaderTimes = QUICK, **settings: object) -> UploadOutcome:
        return upload(self.file, self.transport(), times=times, **settings)  # type: ignore[arg-type]

    @property
    def holds_the_file(self) -> bool:
        """Bit by bit from the end of the bootloader on."""
        content = self.file.read_bytes()
        return self.bootloader.memory[BOOTLOADER_BYTES : len(content)] == content[BOOTLOADER_BYTES:]

    def touched(self, kind: str) -> list[int]:
        """Sectors in the order in which they were erased or written, without repetition in a row."""
        sectors = [touch.start // SECTOR_BYTES * SECTOR_BYTES for touch in self.bootloader.log if touch.kind == kind]
        return [s for k, s in enumerate(sectors) if k == 0 or sectors[k - 1] != s]

    def assert_bootloader_untouched(self) -> None:
        assert all(touch.start >= BOOTLOADER_BYTES for touch in self.bootloader.log)
        assert self.bootloader.memory[:BOOTLOADER_BYTES] == OLD[:BOOTLOADER_BYTES]
        assert self.bus.resets == 0
