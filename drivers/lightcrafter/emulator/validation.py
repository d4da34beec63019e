"""The checks that the controller makes of a sequence."""

from __future__ import annotations

from drivers.lightcrafter import planes
from drivers.lightcrafter.values import LutControl, LutEntry, Timing, Trigger, Validation

_LEAST_GAP_US = 230


def validate(
    entries: tuple[LutEntry, ...], images: tuple[int, ...], timing: Timing, control: LutControl, flash_images: int
) -> Validation:
    """Bits that are set. The controller checks less of the images: there a wrong sequence just looks wrong."""
    found = Validation(0)
    gap_us = timing.period_us - timing.exposure_us
    longest_us = max((planes.minimum_exposure_us(entry.depth) for entry in entries), default=0)
    if gap_us < 0 or timing.exposure_us < longest_us:
        found |= Validation.EXPOSURE_INVALID
    if 0 < gap_us <= _LEAST_GAP_US:
        found |= Validation.GAP_SHORT
    if gap_us == 0:
        found |= Validation.TRIGGER_CONTINUOUS
    complete = len(entries) == control.entries and len(images) == control.images
    once = control.repeat or control.patterns == control.entries
    if not (complete and once and _shows_something(entries, images, flash_images)):
        found |= Validation.PATTERN_INVALID
    return found


def _shows_something(entries: tuple[LutEntry, ...], images: tuple[int, ...], flash_images: int) -> bool:
    first = entries[0]
    return (
        first.swap
        and first.trigger is not Trigger.CONTINUE
        and sum(entry.swap for entry in entries) == len(images)
        and all(index < flash_images for index in images)
        and all(_exists(entry) for entry in entries)
    )


def _exists(entry: LutEntry) -> bool:
    try:
        planes.lowest_plane(entry.number, entry.depth)
    except ValueError:
        return False
    return True
