"""The checks that the controller makes of a sequence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.lightcrafter import commands as c
from drivers.lightcrafter import planes
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.emulator.video import plays_video
from drivers.lightcrafter.sequence import VIDEO_FRAME_US
from drivers.lightcrafter.values import LutControl, LutEntry, Timing, Trigger, TriggerMode, Validation

_LEAST_GAP_US = 230


def validate(
    entries: tuple[LutEntry, ...], images: tuple[int, ...], values: Mapping[Command[Any], Any], flash_images: int
) -> Validation:
    """Bits that are set, with the registers' values. The real one checks less: there a wrong sequence looks wrong."""
    timing, control = values[c.TIMING], values[c.LUT_CONTROL]
    if plays_video(values):
        found = _validate_video(entries, timing, control)
    else:
        found = _validate_flash(entries, images, timing, control, flash_images)
    if values[c.TRIGGER_MODE] is not (TriggerMode.VSYNC if plays_video(values) else TriggerMode.INTERNAL):
        found |= Validation.PATTERN_INVALID
    return found


def _validate_flash(
    entries: tuple[LutEntry, ...], images: tuple[int, ...], timing: Timing, control: LutControl, flash_images: int
) -> Validation:
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


def _validate_video(entries: tuple[LutEntry, ...], timing: Timing, control: LutControl) -> Validation:
    """The first entry waits for a frame, the others follow it, and together they fit into its time."""
    found = Validation.TRIGGER_CONTINUOUS
    longest_us = max((planes.minimum_exposure_us(entry.depth) for entry in entries), default=0)
    fits = len(entries) * timing.period_us <= VIDEO_FRAME_US
    if timing.exposure_us != timing.period_us or timing.exposure_us < longest_us or not fits:
        found |= Validation.EXPOSURE_INVALID
    waits = [(entry.trigger is not Trigger.CONTINUE, entry.swap) for entry in entries]
    complete = len(entries) == control.entries and control.repeat
    if not (complete and waits == [(k == 0, k == 0) for k in range(len(waits))] and all(map(_exists, entries))):
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
