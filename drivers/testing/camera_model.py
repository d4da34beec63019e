"""What a camera should do, as a few numbers: the model that the random walk compares with."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.camera import AppliedSettings, CameraState, Trigger


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

    def allows(self, *states: CameraState) -> bool:
        return not self.dead and self.state in states

    def armed(self, trigger: Trigger) -> None:
        self.state, self.trigger, self.pending, self.taken = CameraState.ARMED, trigger, 0, 0

    def exposed(self, trigger: Trigger, count: int = 1) -> None:
        """Pulses or calls reached the camera."""
        if self.allows(CameraState.ARMED) and self.trigger is trigger:
            self.pending += count

    def disarmed(self) -> None:
        if self.state is CameraState.ARMED:
            self.state = CameraState.CONFIGURED

    def closed(self) -> None:
        self.state, self.dead, self.applied = CameraState.CLOSED, False, None

    def unplugged(self) -> None:
        self.plugged = False
        self.dead = self.state is not CameraState.CLOSED

    def agrees(self, state: CameraState) -> bool:
        """A dead device may be known as such or not yet."""
        return state == self.state or (self.dead and state == CameraState.FAULT)
