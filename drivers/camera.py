"""Cameras as the rest of the program sees them.

```
CLOSED --open--> OPEN --configure--> CONFIGURED --arm--> ARMED --disarm--> CONFIGURED
                                          any state --close--> CLOSED
                                          any state --the device dies--> FAULT --close--> CLOSED
```
A call that the state does not allow raises DeviceStateError. ``configure`` is allowed in OPEN and CONFIGURED;
``disarm`` and ``close`` are allowed everywhere and never raise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, Protocol, runtime_checkable

from pydantic import BaseModel, ConfigDict, Field

from models.capture import Image

Origin = Literal["real", "simulated", "replayed"]
BitDepth = Literal[8, 12]


class CameraState(StrEnum):
    """Where a camera stands in the diagram above."""

    CLOSED = "closed"
    OPEN = "open"
    CONFIGURED = "configured"
    ARMED = "armed"
    FAULT = "fault"


class Trigger(StrEnum):
    """What starts an exposure."""

    HARDWARE_EDGE = "hardware_edge"
    """A pulse of the projector on the camera's trigger line."""
    SOFTWARE = "software"
    """A call of ``software_trigger``."""
    FREE_RUN = "free_run"
    """The camera itself, again and again: for the live view."""


@dataclass(frozen=True)
class CameraLimits:
    """Smallest and largest settings that the camera takes."""

    exposure_us: tuple[float, float]
    gain_db: tuple[float, float]
    bit_depths: tuple[BitDepth, ...] = (8,)


@dataclass(frozen=True)
class CameraInfo:
    """A camera that answers. size: (width, height) px as delivered. first_frame_id: of the first frame after arming."""

    driver: str
    model: str
    serial: str
    firmware: str
    origin: Origin
    size: tuple[int, int]
    limits: CameraLimits
    first_frame_id: int = 0


class CameraSettings(BaseModel):
    """What is asked of a camera. exposure_us: microseconds. gain_db: decibels."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    exposure_us: float = Field(8333.0, gt=0, allow_inf_nan=False)
    gain_db: float = Field(0.0, allow_inf_nan=False)
    bit_depth: BitDepth = 8


@dataclass(frozen=True)
class AppliedSettings:
    """What the camera holds, read back from it after snapping to its steps.

    size: (width, height) px. white_level: reading of a saturated pixel. features: what else the driver read back
    (gamma, automatic functions, trigger line ...), compared before and after a sequence.
    """

    exposure_us: float
    gain_db: float
    bit_depth: int
    white_level: int
    size: tuple[int, int]
    features: Mapping[str, str | float | bool] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    image: (height, width) uint8 or uint16, the receiver's own copy. frame_id: counted by the camera since arming.
    device_ns: start of exposure on the camera's own free-running clock. host_ns: arrival, ``time.monotonic_ns``.
    """

    image: Image
    frame_id: int
    device_ns: int
    host_ns: int
    exposure_us: float
    gain_db: float


@dataclass(frozen=True)
class StreamStatistics:
    """What a camera says about the frames since it was armed.

    delivered: handed to the caller. unclaimed: whole frames left in the queue. lost: counted by the driver as lost.
    """

    delivered: int = 0
    unclaimed: int = 0
    lost: int = 0


@runtime_checkable
class Camera(Protocol):
    """One camera. Every camera runs freely; what else can start it shows in the protocols below.

    All calls come from one thread at a time, except ``close`` and ``disarm``, which may come from any.
    """

    @property
    def name(self) -> str:
        """Role in the rig: "left camera" or "right camera"; begins every error."""
        ...

    @property
    def state(self) -> CameraState: ...

    def open(self) -> CameraInfo:
        """Connect. Raises DeviceNotFoundError, DeviceBusyError, DevicePermissionError, DeviceUnavailableError."""
        ...

    @property
    def info(self) -> CameraInfo:
        """What ``open`` returned, brought up to date; DeviceStateError while closed."""
        ...

    def configure(self, settings: CameraSettings) -> AppliedSettings:
        """Apply and read back. Raises DeviceConfigurationError where a limit is passed, leaving the old settings."""
        ...

    def read_settings(self) -> AppliedSettings:
        """Read what the camera holds now. Allowed from CONFIGURED on."""
        ...

    def arm(self, frames: int | None, trigger: Trigger) -> None:
        """Get ready and return only when the first pulse would be seen.

        frames: how many are expected, None for endless. Frames beyond them are queued all the same, so that an extra
        pulse is noticed. Raises DeviceConfigurationError for a trigger that the camera has not.
        """
        ...

    def check(self) -> None:
        """Ask the device for a sign of life; does nothing while closed, and changes nothing in any other state.

        Raises DeviceLostError, and the state is FAULT, where none comes.
        """
        ...

    def wait_frame(self, timeout_s: float) -> Frame:
        """The next frame in order of arrival.

        Raises FrameTimeoutError (the camera stays armed and may be asked again), IncompleteFrameError (likewise),
        DeviceLostError (the state is FAULT).
        """
        ...

    def disarm(self) -> StreamStatistics:
        """Stop and discard what is queued. Idempotent; never raises, not even on a dead device."""
        ...

    def close(self) -> None:
        """Let go of the device. Idempotent; never raises."""
        ...


@runtime_checkable
class EdgeTriggered(Protocol):
    """A camera that a hardware pulse can start."""

    def min_period_us(self, settings: CameraSettings) -> float:
        """Shortest time between two pulses that loses none, from exposure and readout."""
        ...


@runtime_checkable
class SoftwareTriggered(Protocol):
    """A camera that a call can start."""

    def software_trigger(self) -> None:
        """Start one exposure; allowed while armed with Trigger.SOFTWARE. Raises DeviceLostError."""
        ...


def supported_triggers(camera: Camera) -> frozenset[Trigger]:
    """What can start this camera, from what it implements: it cannot claim a mode that it lacks."""
    triggers = {Trigger.FREE_RUN}
    if isinstance(camera, EdgeTriggered):
        triggers.add(Trigger.HARDWARE_EDGE)
    if isinstance(camera, SoftwareTriggered):
        triggers.add(Trigger.SOFTWARE)
    return frozenset(triggers)
