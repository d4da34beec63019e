"""What an emulated controller can be told to do wrong."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(eq=False)
class EmulatedFaults:
    """Set from any thread at any time.

    refused: names of commands that are not accepted. silent: names of commands that get no answer. stuck_validation:
    validation never ends. validation: bits that it adds. stale_replies: answers to nobody before each answer (USB).
    busy_reads: how often in a row a read is not ready (I2C). delay_s: before each answer. deaf_starts: how many starts
    are acknowledged and ignored. wrong_currents: LED currents read back as something else. stuck_mode: the display
    mode does not change. hardware: bits added to the hardware status.
    """

    refused: set[str] = field(default_factory=set)
    silent: set[str] = field(default_factory=set)
    stuck_validation: bool = False
    validation: int = 0
    stale_replies: int = 0
    busy_reads: int = 0
    delay_s: float = 0.0
    deaf_starts: int = 0
    wrong_currents: bool = False
    stuck_mode: bool = False
    no_load_times: bool = False
    hardware: int = 0


@dataclass(eq=False)
class BootloaderFaults:
    """Set from any thread at any time.

    power_lost_after: so many commands are carried out, the next is cut in half and the power goes. wrong_sums: how many
    checksums come out wrong. stuck: busy for ever. manufacturer: of the flash chip. deaf: what the bootloader does not
    know gets no answer instead of a refusal. ignored_entries: how many calls for the bootloader are not followed.
    """

    power_lost_after: int | None = None
    wrong_sums: int = 0
    stuck: bool = False
    manufacturer: int = 0x0020
    deaf: bool = False
    ignored_entries: int = 0
