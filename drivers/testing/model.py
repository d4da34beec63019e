"""What the devices should do, in a few numbers: the model that the random walk compares them with."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.camera import AppliedSettings, CameraState, Trigger
from drivers.projector import ProjectorState


@dataclass
class CameraModel:
    """A camera after the calls made so far.

    pending: exposures since arming whose frames were not taken. taken: frames taken since arming.
    dead: it was unplugged while open, so that every call but ``disarm`` and ``close`` fails.
    """

    state: CameraState = CameraState.CLOSED
    trigger: Trigger | None = None
    applied: AppliedSettings | None = None
    pending: int = 0
    taken: int = 0
    dead: bool = False
    plugged: bool = True

    def may(self, *states: CameraState) -> bool:
        """Whether it lives and is in one of these states."""
        return not self.dead and self.state in states

    def is_armed(self, *triggers: Trigger) -> bool:
        """Whether it lives and is armed with one of these triggers."""
        return self.may(CameraState.ARMED) and self.trigger in triggers

    def arm(self, trigger: Trigger) -> None:
        self.state, self.trigger, self.pending, self.taken = CameraState.ARMED, trigger, 0, 0

    def expose(self, trigger: Trigger, count: int) -> None:
        """Pulses or calls came, whether the camera listens or not."""
        if self.is_armed(trigger):
            self.pending += count

    def disarm(self) -> None:
        if self.state is CameraState.ARMED:
            self.state = CameraState.CONFIGURED

    def close(self) -> None:
        self.state, self.dead, self.applied = CameraState.CLOSED, False, None

    def unplug(self) -> None:
        self.plugged = False
        self.dead = self.state is not CameraState.CLOSED

    def agrees(self, state: CameraState) -> bool:
        """A dead device may be known as such or not yet."""
        return state == self.state or (self.dead and state == CameraState.FAULT)


@dataclass
class ProjectorModel:
    """A projector after the calls made so far, between two sequences. patterns: of the sequence last loaded."""

    state: ProjectorState = ProjectorState.CLOSED
    patterns: int = 0
    dead: bool = False
    plugged: bool = True

    def may(self, *states: ProjectorState) -> bool:
        """Whether it lives and is in one of these states."""
        return not self.dead and self.state in states

    def stop(self) -> None:
        if self.state is ProjectorState.HOLDING:
            self.state = ProjectorState.OPEN

    def close(self) -> None:
        self.state, self.dead = ProjectorState.CLOSED, False

    def unplug(self) -> None:
        self.plugged = False
        self.dead = self.state is not ProjectorState.CLOSED

    def agrees(self, state: ProjectorState) -> bool:
        """As for the camera."""
        return state == self.state or (self.dead and state == ProjectorState.FAULT)
