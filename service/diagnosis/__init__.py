"""An examination of the computer, the library, the rig's devices and their calibration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from service.diagnosis.computer import examine_computer
from service.diagnosis.host import examine_host
from service.diagnosis.library import examine_library
from service.diagnosis.rig import examine_rig
from service.diagnosis.symptom import Symptom
from service.settings import ServiceSettings

__all__ = ["Symptom", "examine"]


def examine(settings: ServiceSettings, *, exposure: bool = True, root: Path = Path("/")) -> tuple[Symptom, ...]:
    """Everything, in the order in which one would mend it; opens and closes the rig's devices.

    exposure: show a short sequence to count its trigger pulses, and take one capture; else no light. root: where the
    system's /dev, /etc, /run, /sys and /usr lie.
    """

    def symptoms() -> Iterator[Symptom]:
        yield from examine_computer()
        yield from examine_library(settings)
        yield from examine_host(settings.rig, root)
        yield from examine_rig(settings, exposure=exposure)

    return tuple(symptoms())
