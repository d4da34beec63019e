"""What a check found wrong with a sequence: which device, which frame, why."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Fault(StrEnum):
    """Kinds of findings; the words are stable and reach programs through problem details."""

    NO_TRIGGER = "no_trigger"
    """A camera saw no pulse at all."""
    NOT_STARTED = "not_started"
    """No camera saw a pulse: the projector did not start."""
    DROPPED = "dropped"
    """The camera counted a frame that never arrived."""
    IGNORED = "ignored"
    """A pulse came while the camera was not ready."""
    EXTRA = "extra"
    """More frames than pulses."""
    EARLY = "early"
    """A frame came before the projector started."""
    LATE = "late"
    """A frame arrived long after its exposure."""
    INCOMPLETE = "incomplete"
    """A frame arrived damaged."""
    LOST = "lost"
    """The device stopped answering."""
    INTERVAL = "interval"
    """Frames are not spaced as the pulses were."""
    SETTINGS = "settings"
    """A device's settings changed by themselves during the sequence."""
    SATURATED = "saturated"
    """Too much of the scene is at full scale."""
    DARK = "dark"
    """The projector's light does not show."""
    MODULATION = "modulation"
    """Fringes are too weak."""
    ORDER = "order"
    """A frame shows another pattern than it should."""
    MOTION = "motion"
    """The scene moved during the sequence."""


@dataclass(frozen=True)
class Finding:
    """One finding.

    device: role in the rig ("left camera", "projector"). message: one line that names device, frame and pattern, and
    says what to do. index: exposure in the plan, from 0. fatal: the sequence must not be kept.
    """

    fault: Fault
    device: str
    message: str
    index: int | None = None
    pattern: str | None = None
    fatal: bool = True

    def as_json(self) -> dict[str, object]:
        """As it appears in problem details and in a capture's record."""
        return {
            "fault": str(self.fault),
            "device": self.device,
            "index": self.index,
            "pattern": self.pattern,
            "message": self.message,
        }
