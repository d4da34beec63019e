"""A plan of patterns as entries of the controller's LUTs, checked before anything is sent."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from drivers.errors import SequenceInvalidError
from drivers.lightcrafter import planes
from drivers.lightcrafter.commands import NAME
from drivers.lightcrafter.manifest import FlashManifest, StoredPattern
from drivers.lightcrafter.planes import PLANES, Depth
from drivers.lightcrafter.values import (
    MAXIMUM_IMAGES,
    LedSelect,
    LutControl,
    LutEntry,
    PatternSource,
    Timing,
    Trigger,
    TriggerMode,
)
from drivers.projector import LoadedSequence, ProjectorInfo
from drivers.sequence_rules import check_plan
from models.patterns import Pattern, PatternPlan

LONGEST_PERIOD_US = 200_000_000
VIDEO_FRAME_US = 16_667
"""Of a video input at 60 Hz."""
LoadTime = Callable[[int], float]
"""How long a flash image takes to come into the buffer, microseconds, by its index."""


@dataclass(frozen=True)
class Program:
    """What is sent to the controller for one sequence.

    images: flash image of each buffer swap, in the order of the swaps; none where the patterns come as video. source:
    where the patterns come from.
    """

    entries: tuple[LutEntry, ...]
    images: tuple[int, ...]
    timing: Timing
    repeat: bool = False
    source: PatternSource = PatternSource.FLASH

    @property
    def control(self) -> LutControl:
        """The second trigger output pulses once a video frame, and at each pattern where one of flash repeats."""
        shown = 1 if self.repeat and self.source is PatternSource.FLASH else len(self.entries)
        return LutControl(len(self.entries), self.repeat, shown, max(1, len(self.images)))

    @property
    def trigger_mode(self) -> TriggerMode:
        """What starts the sequence: a video frame, or the controller itself."""
        return TriggerMode.VSYNC if self.source is PatternSource.VIDEO else TriggerMode.INTERNAL


def compile_plan(
    plan: PatternPlan,
    period_us: float,
    manifest: FlashManifest,
    info: ProjectorInfo,
    load_us: LoadTime,
    leds: LedSelect = LedSelect.WHITE,
) -> tuple[Program, LoadedSequence]:
    """The plan as the controller shows it once.

    Pulses come ``period_us`` apart, and further where the dark time after a pattern or the load of an image needs it.
    Raises SequenceInvalidError naming the pattern that cannot be shown.
    """
    checked = check_plan(plan, period_us, info)
    stored = [find_stored(pattern, manifest) for pattern in plan.patterns]
    exposure_us = _common_exposure(plan, stored)
    shortest_us = checked.pulses_us[1] if len(plan) > 1 else max(period_us, exposure_us + info.limits.dark_us)
    longest_load_us = max(_loads(stored, load_us), default=0.0)
    period = math.ceil(max(shortest_us, longest_load_us))
    if period > LONGEST_PERIOD_US:
        raise SequenceInvalidError(
            NAME,
            f"plan '{plan.name}' would need a period of {period} us; {info.limits.exposure_us[1]:g} us are the most",
        )
    images = _images(stored)
    swaps = _swaps(stored)
    entries = tuple(
        LutEntry(s.number, s.depth, leds=leds, black=True, swap=swap) for s, swap in zip(stored, swaps, strict=True)
    )
    pulses_us = tuple(float(k * period) for k in range(len(plan)))
    loaded = LoadedSequence(plan, pulses_us, pulses_us[-1] + exposure_us)
    return Program(entries, images, Timing(exposure_us, period)), loaded


def hold_program(stored: StoredPattern, exposure_us: int, leds: LedSelect = LedSelect.WHITE) -> Program:
    """One pattern over and over, without dark between."""
    exposure_us = max(exposure_us, planes.minimum_exposure_us(stored.depth))
    entry = LutEntry(stored.number, stored.depth, leds=leds, swap=True)
    return Program((entry,), (stored.image,), Timing(exposure_us, exposure_us), repeat=True)


def video_program(depth: Depth, leds: LedSelect = LedSelect.WHITE, patterns: int | None = None) -> Program:
    """The first patterns of each video frame at 60 Hz, over and over, without dark between.

    patterns: how many a frame; None takes as many as fit, two of 8 bits for 8333 us each or 24 of one bit for 694 us.
    Raises SequenceInvalidError for more.
    """
    most = min(PLANES // depth, VIDEO_FRAME_US // planes.minimum_exposure_us(depth))
    count = most if patterns is None else patterns
    if not 1 <= count <= most:
        raise SequenceInvalidError(
            NAME,
            f"{count} patterns of {depth} bits do not go into a video frame of {VIDEO_FRAME_US} us; 1 to {most} do",
        )
    first = LutEntry(0, depth, Trigger.EXTERNAL_POSITIVE, leds, swap=True)
    rest = (LutEntry(number, depth, Trigger.CONTINUE, leds) for number in range(1, count))
    exposure_us = VIDEO_FRAME_US // count
    return Program((first, *rest), (), Timing(exposure_us, exposure_us), repeat=True, source=PatternSource.VIDEO)


def find_stored(pattern: Pattern, manifest: FlashManifest) -> StoredPattern:
    """Where the pattern lies; exposures may differ. SequenceInvalidError where flash does not hold it."""
    wanted = _content(pattern)
    for stored in manifest.patterns:
        if _content(stored.pattern) == wanted:
            return stored
    raise SequenceInvalidError(NAME, f"pattern '{pattern.name}' is not stored with these parameters")


def _content(pattern: Pattern) -> Pattern:
    return pattern.model_copy(update={"exposure_us": None})


def _common_exposure(plan: PatternPlan, stored: list[StoredPattern]) -> int:
    """The controller gives every pattern of a sequence one exposure."""
    first = plan.patterns[0]
    assert first.exposure_us is not None  # check_plan refuses plans without
    for pattern, place in zip(plan.patterns, stored, strict=True):
        if pattern.exposure_us != first.exposure_us:
            raise SequenceInvalidError(
                NAME,
                f"pattern '{pattern.name}' is to last {pattern.exposure_us:g} us and '{first.name}' "
                f"{first.exposure_us:g} us; all patterns of a sequence last equally long",
            )
        least_us = planes.minimum_exposure_us(place.depth)
        if first.exposure_us < least_us:
            raise SequenceInvalidError(
                NAME,
                f"pattern '{pattern.name}' is stored with {place.depth} bits and is to last {first.exposure_us:g} us; "
                f"{least_us} us are the least",
            )
    return math.ceil(first.exposure_us)


def _swaps(stored: list[StoredPattern]) -> tuple[bool, ...]:
    """Where the next image is needed: at the first pattern and wherever the image changes."""
    return tuple(k == 0 or s.image != stored[k - 1].image for k, s in enumerate(stored))


def _images(stored: list[StoredPattern]) -> tuple[int, ...]:
    at = [k for k, swap in enumerate(_swaps(stored)) if swap]
    if len(at) > MAXIMUM_IMAGES:
        name = stored[at[MAXIMUM_IMAGES]].pattern.name
        raise SequenceInvalidError(
            NAME,
            f"pattern '{name}' needs image number {MAXIMUM_IMAGES + 1} of the sequence; {MAXIMUM_IMAGES} are the most; "
            "put patterns of one image next to each other",
        )
    return tuple(stored[k].image for k in at)


def _loads(stored: list[StoredPattern], load_us: LoadTime) -> Iterator[float]:
    """Shortest period that each load allows: an image comes while the patterns of the one before it are shown."""
    at = [k for k, swap in enumerate(_swaps(stored)) if swap]
    known: dict[int, float] = {}
    for before, here in itertools.pairwise(at):
        image = stored[here].image
        if image not in known:
            known[image] = load_us(image)
        yield known[image] / (here - before)
