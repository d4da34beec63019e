"""Projectors as the rest of the program sees them.

```
CLOSED --open--> OPEN --load--> LOADED --start--> PROJECTING --all shown, or stop--> LOADED
                 OPEN, LOADED --show--> HOLDING --show(None), stop--> OPEN
                          any state --close--> CLOSED
                          any state --the device dies--> FAULT --close--> CLOSED
```
A call that the state does not allow raises DeviceStateError. ``load``, ``configure`` and ``show`` are allowed in OPEN,
LOADED and HOLDING (``load`` ends the holding); ``stop`` and ``close`` are allowed everywhere and never raise.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

from pydantic import BaseModel, ConfigDict, Field

from drivers.camera import Origin
from models.patterns import MINIMUM_8BIT_EXPOSURE_US, Pattern, PatternPlan, Raster


class ProjectorState(StrEnum):
    """Where a projector stands in the diagram above."""

    CLOSED = "closed"
    OPEN = "open"
    LOADED = "loaded"
    PROJECTING = "projecting"
    HOLDING = "holding"
    FAULT = "fault"


@dataclass(frozen=True)
class ProjectorLimits:
    """What a sequence must keep to.

    exposure_us: shortest and longest exposure of an 8-bit pattern. binary_exposure_us: shortest of a 1-bit pattern.
    dark_us: shortest time from the end of a pattern to the next, where there is any. patterns: longest sequence.
    """

    exposure_us: tuple[float, float] = (float(MINIMUM_8BIT_EXPOSURE_US), 2_000_000.0)
    binary_exposure_us: float = 235.0
    dark_us: float = 230.0
    patterns: int = 128


@dataclass(frozen=True)
class ProjectorInfo:
    """A projector that answers. raster: its mirrors, None where unknown (replay of a rig whose projector is unknown).

    stored: the patterns that it can show, in exposure order, with their parameters; None where it shows any.
    """

    driver: str
    model: str
    serial: str
    firmware: str
    origin: Origin
    raster: Raster | None
    limits: ProjectorLimits = ProjectorLimits()
    stored: PatternPlan | None = None


class ProjectorSettings(BaseModel):
    """What is asked of a projector. brightness: share of the largest LED current allowed, 0..1."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    brightness: float = Field(1.0, ge=0, le=1, allow_inf_nan=False)


@dataclass(frozen=True)
class LoadedSequence:
    """A plan as the projector will show it.

    pulses_us: when each pattern's trigger pulse comes, microseconds after the first. duration_us: first pulse to dark.
    """

    plan: PatternPlan
    pulses_us: tuple[float, ...]
    duration_us: float


@runtime_checkable
class Projector(Protocol):
    """One projector, master of the cameras' trigger line: each pattern of a sequence sends one pulse as it appears.

    All calls come from one thread at a time, except ``close`` and ``stop``, which may come from any.
    """

    @property
    def name(self) -> str:
        """Role in the rig: "projector"; begins every error."""
        ...

    @property
    def state(self) -> ProjectorState: ...

    def open(self) -> ProjectorInfo:
        """Connect; the projector is dark afterwards.

        Raises DeviceNotFoundError, DeviceBusyError, DevicePermissionError, DeviceUnavailableError.
        """
        ...

    @property
    def info(self) -> ProjectorInfo:
        """What ``open`` returned, brought up to date; DeviceStateError while closed."""
        ...

    def configure(self, settings: ProjectorSettings) -> ProjectorSettings:
        """Apply and read back. Raises DeviceConfigurationError where a limit is passed."""
        ...

    def load(self, plan: PatternPlan, period_us: float) -> LoadedSequence:
        """Load and validate a sequence without showing it.

        Each pattern is lit for its own ``exposure_us``; pulses come at least ``period_us`` apart. Raises
        SequenceInvalidError, naming the pattern, where an exposure is missing, too short for 8 bits, longer than the
        period allows, the plan too long, or a pattern not stored.
        """
        ...

    def start(self) -> None:
        """Show the loaded sequence once; returns at once. Raises ProtocolError or DeviceLostError if it cannot."""
        ...

    def check(self) -> None:
        """Ask the device for a sign of life; does nothing while closed, and changes nothing in any other state.

        Raises DeviceLostError, and the state is FAULT, where none comes.
        """
        ...

    def show(self, pattern: Pattern | None) -> None:
        """Hold one pattern, or None for dark. SequenceInvalidError if it is not stored.

        The trigger line may rise once as the pattern appears: no camera may be armed for pulses meanwhile.
        """
        ...

    def stop(self) -> None:
        """Go dark and send no more pulses. Idempotent; never raises, not even on a dead device."""
        ...

    def close(self) -> None:
        """Go dark and let go of the device. Idempotent; never raises."""
        ...
