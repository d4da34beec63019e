"""What can be told of an open LightCrafter 4500: firmware, faults, flash, and what its LEDs draw."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.settings import LedLimits
from drivers.lightcrafter.values import HardwareStatus, Release, words

_SUPPLY_A = 0.9611
_SUPPLY_A_PER_STEP = (0.0069, 0.0071, 0.0063)
"""Straight lines through currents that WallaceIT/dlpc350 measured at the EVM's supply."""
SUPPLY_LIMIT_A = 4.3
"""What the EVM's 5 A supply is known to bear; beyond it boards browned out at full white (E2E 432952)."""


@dataclass(frozen=True)
class ProjectorReport:
    """firmware: of the application. faults: of the hardware status in words, empty where it is well.

    flash_images, needed_images: that are there, and that the manifest counts on. drive, limits: of the red, green and
    blue LED, 0..255. location: where it is attached.
    """

    location: str
    firmware: Release
    faults: str
    flash_images: int
    needed_images: int
    drive: LedLimits
    limits: LedLimits

    @property
    def over_limit(self) -> tuple[str, ...]:
        """Colours that are driven beyond what the settings allow."""
        together = zip(("red", "green", "blue"), self.drive, self.limits, strict=True)
        return tuple(colour for colour, drive, limit in together if drive > limit)

    @property
    def supply_a(self) -> float:
        """Estimated current of the whole board, ampere, with all LEDs lit."""
        return supply_a(self.drive)


def supply_a(drive: LedLimits) -> float:
    """Current that the EVM draws, ampere, under such a drive of its LEDs, 0..255."""
    return _SUPPLY_A + sum(step * value for step, value in zip(_SUPPLY_A_PER_STEP, drive, strict=True))


def examine_projector(projector: LightCrafter) -> ProjectorReport:
    """Ask an open projector that shows nothing; nothing is changed.

    Raises DeviceStateError in any other state, DeviceLostError and ProtocolError where it does not answer well.
    """
    configuration = projector.configuration
    with projector.asked() as console:
        status = console.read(c.HARDWARE_STATUS)
        faults = words(status)
        if HardwareStatus.INITIALISED not in status:
            faults = "; ".join(filter(None, ("it did not initialise", faults)))
        currents = console.read(c.LED_CURRENT)
        red, green, blue = (255 - value if configuration.led_inverted else value for value in currents)
        return ProjectorReport(
            location=projector.info.serial,
            firmware=console.read(c.VERSION).application,
            faults=faults,
            flash_images=console.read(c.FLASH_IMAGES),
            needed_images=projector.manifest.images,
            drive=(red, green, blue),
            limits=configuration.led_limits,
        )
