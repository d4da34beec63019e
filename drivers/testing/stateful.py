"""A random walk of calls over a camera and the projector that triggers it, compared with a model of the diagrams.

Hypothesis chooses the calls, and shortens a walk that failed to the few calls that matter.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from drivers.camera import CameraState, EdgeTriggered, Frame, Trigger, supported_triggers
from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceStateError,
    DriverError,
    FrameTimeoutError,
    SequenceInvalidError,
)
from drivers.projector import ProjectorState
from drivers.testing import camera_states, projector_states
from drivers.testing.bench import CameraBench, ProjectorBench, short_settings
from drivers.testing.camera_frames import Waiting, check_frame
from drivers.testing.camera_settings import beyond
from drivers.testing.expect import assert_no_new_threads, assert_state, check_message, refused, wait_until
from drivers.testing.model import CameraModel, ProjectorModel
from drivers.testing.projector_plans import showable, with_exposure

MakeBenches = Callable[[], tuple[CameraBench, ProjectorBench]]
_LOST = (DeviceLostError, DeviceStateError)
_ASKED = (Trigger.HARDWARE_EDGE, Trigger.SOFTWARE)
_IDLE = (ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING)


def camera_machine(make_benches: MakeBenches) -> type[RuleBasedStateMachine]:
    """The random walk over benches that share one trigger line; ``.TestCase`` of what it returns is the test.

    make_benches: called once a walk; its camera and projector are closed. The camera must take hardware pulses.
    """

    class CameraAndProjector(Walk):
        def __init__(self) -> None:
            super().__init__(*make_benches())

    CameraAndProjector.TestCase.settings = settings(
        max_examples=100,
        stateful_step_count=30,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    return CameraAndProjector


class Walk(RuleBasedStateMachine):
    """One walk. ``model`` and ``shown`` are the camera and the projector as they should be."""

    def __init__(self, bench: CameraBench, projector_bench: ProjectorBench) -> None:
        super().__init__()
        self.threads = set(threading.enumerate())
        self.bench, self.projector_bench = bench, projector_bench
        self.camera, self.projector = bench.camera, projector_bench.projector
        self.model, self.shown = CameraModel(), ProjectorModel()

    @initialize()
    def learn_limits(self) -> None:
        """Limits of both devices, and a period at which the camera loses no pulse."""
        self.info, self.projector_info = self.camera.open(), self.projector.open()
        assert isinstance(self.camera, EdgeTriggered)
        short = short_settings(self.info.limits)
        longest_us = self.info.limits.exposure_us[1]
        self.choices = (short, short.model_copy(update={"exposure_us": min(1.5 * short.exposure_us, longest_us)}))
        camera_us = (1.01 * self.camera.min_period_us(choice) for choice in self.choices)
        self.period_us = max(self.projector_info.limits.exposure_us[0], *camera_us)
        self.camera.close()
        self.projector.close()

    @rule()
    @precondition(lambda self: self.model.state is CameraState.CLOSED or self.model.dead)
    def open(self) -> None:
        """From wherever the camera was left."""
        self.camera.close()
        self.model.close()
        if not self.model.plugged:
            with refused(self.camera, DriverError):
                self.camera.open()
            self.bench.replug()
            self.model.plugged = True
        assert self.camera.open() == self.info
        self.model.state = CameraState.OPEN

    @rule(choice=st.integers(0, 1))
    @precondition(lambda self: self.model.may(CameraState.OPEN, CameraState.CONFIGURED))
    def configure(self, choice: int) -> None:
        self.model.applied = self.camera.configure(self.choices[choice])
        self.model.state = CameraState.CONFIGURED

    @rule(which=st.integers(0, 3))
    @precondition(lambda self: self.model.may(CameraState.OPEN, CameraState.CONFIGURED))
    def configure_beyond_a_limit(self, which: int) -> None:
        asked = [settings for _, settings in beyond(self.info.limits)][which]
        with refused(self.camera, DeviceConfigurationError):
            self.camera.configure(asked)

    @rule(choice=st.integers(0, 5), frames=st.sampled_from([None, 1, 5]))
    def arm(self, choice: int, frames: int | None) -> None:
        """From any state, by the way that the diagram shows: else few walks would come here."""
        triggers = sorted(supported_triggers(self.camera), key=list(Trigger).index)
        trigger = triggers[choice % len(triggers)]
        if not self.model.may(CameraState.OPEN, CameraState.CONFIGURED, CameraState.ARMED):
            self.open()
        if self.model.state is CameraState.OPEN:
            self.configure(choice % 2)
        self.disarm()
        self.camera.arm(frames, trigger)
        self.model.arm(trigger)

    @rule(trigger=st.sampled_from(_ASKED), count=st.integers(1, 3))
    @precondition(lambda self: self.model.may(CameraState.CONFIGURED, CameraState.ARMED))
    def expose(self, trigger: Trigger, count: int) -> None:
        """Pulses come whether the camera listens or not; calls only where they are allowed."""
        if self.bench.has(trigger) and (trigger is Trigger.HARDWARE_EDGE or self.model.is_armed(trigger)):
            self.bench.fire(trigger, count)
            self.model.expose(trigger, count)

    @rule()
    @precondition(lambda self: self.model.may(CameraState.ARMED))
    def wait_frame(self) -> None:
        if self.model.trigger is Trigger.FREE_RUN or self.model.pending:
            self._claim(self.camera.wait_frame(self.bench.patience_s))
        else:
            with refused(self.camera, FrameTimeoutError):
                self.camera.wait_frame(0.01)

    def _claim(self, frame: Frame) -> None:
        assert self.model.applied is not None
        check_frame(frame, self.model.applied)
        if self.model.trigger is not Trigger.FREE_RUN:
            assert frame.frame_id == self.info.first_frame_id + self.model.taken
            self.model.pending -= 1
        self.model.taken += 1

    @rule()
    @precondition(lambda self: self.model.dead)
    def wait_for_what_a_dead_camera_left(self) -> None:
        """Frames that had come before may still be had; then it says that it is gone."""
        with refused(self.camera, *_LOST, keeps_state=False):
            for _ in range(self.model.pending + 1):
                self._claim(self.camera.wait_frame(self.bench.patience_s))
        assert_state(self.camera, CameraState.FAULT)

    @rule()
    @precondition(lambda self: self.model.state is not CameraState.CLOSED)
    def disarm(self) -> None:
        statistics = self.camera.disarm()
        if self.model.may(CameraState.ARMED):
            assert statistics.delivered == self.model.taken
        if self.model.is_armed(*_ASKED):
            assert statistics.unclaimed + statistics.lost <= self.model.pending
        self.model.disarm()

    @rule(how=st.sampled_from(["disarm", "close"]))
    @precondition(lambda self: self.model.is_armed(*_ASKED) and self.model.pending == 0)
    def cancel_while_another_thread_waits(self, how: str) -> None:
        waiting = Waiting(self.camera)
        if how == "disarm":
            self.disarm()
        else:
            self.leave(how)
        check_message(self.camera, waiting.outcome(self.bench.patience_s))

    @rule(how=st.sampled_from(["close", "unplug"]))
    @precondition(lambda self: self.model.state is not CameraState.CLOSED)
    def leave(self, how: str) -> None:
        if how == "unplug" and self.bench.unplug is not None and self.model.plugged:
            self.bench.pull()
            self.model.unplug()
        else:
            self.camera.close()
            self.model.close()

    @rule(which=st.integers(0, 100))
    def call_the_camera_illegally(self, which: int) -> None:
        dead = self.model.dead
        calls = ("open", "configure", "read_settings", "arm") if dead else camera_states.ILLEGAL[self.model.state]
        trigger = max(supported_triggers(self.camera))
        with refused(self.camera, *(_LOST if dead else (DeviceStateError,)), keeps_state=not dead):
            camera_states.CALLS[calls[which % len(calls)]](self.camera, trigger)
        if dead:
            assert_state(self.camera, CameraState.FAULT)

    @rule()
    @precondition(lambda self: self.shown.state is ProjectorState.CLOSED or self.shown.dead)
    def open_projector(self) -> None:
        """From wherever the projector was left."""
        self.projector.close()
        self.shown.close()
        if not self.shown.plugged:
            with refused(self.projector, DriverError):
                self.projector.open()
            self.projector_bench.replug()
            self.shown.plugged = True
        assert self.projector.open() == self.projector_info
        self.shown.state = ProjectorState.OPEN
        with refused(self.projector, SequenceInvalidError):
            self.projector.load(with_exposure(showable(self.projector_info, 2), 0, None), self.period_us)

    @rule(count=st.integers(1, 3))
    def load(self, count: int) -> None:
        if not self.shown.may(*_IDLE):
            self.open_projector()
        loaded = self.projector.load(showable(self.projector_info, count), self.period_us)
        self.shown.state, self.shown.patterns = ProjectorState.LOADED, len(loaded.plan)

    @rule(ending=st.sampled_from(["all shown", "stop", "close", "unplug"]), count=st.integers(1, 3))
    def start(self, ending: str, count: int) -> None:
        """Whatever ends the sequence, the camera saw as many pulses as the trigger line."""
        if not self.shown.may(ProjectorState.LOADED):
            self.load(count)
        before = self.projector_bench.pulses()
        self.projector.start()
        if ending == "all shown":
            patience_s = self.projector_bench.patience_s
            assert wait_until(lambda: self.projector.state != ProjectorState.PROJECTING, patience_s)
            assert self.projector_bench.pulses() - before == self.shown.patterns
        else:
            self.leave_projector(ending)
        self.model.expose(Trigger.HARDWARE_EDGE, self.projector_bench.pulses() - before)

    @rule(dark=st.booleans())
    @precondition(lambda self: self.shown.may(*_IDLE) and not self.model.is_armed(Trigger.HARDWARE_EDGE))
    def show(self, dark: bool) -> None:
        """The trigger line may rise as the holding begins, so no camera is armed for pulses."""
        if not dark:
            self.projector.show(showable(self.projector_info, 1).patterns[0])
            self.shown.state = ProjectorState.HOLDING
        elif self.shown.state is ProjectorState.HOLDING:
            self.projector.show(None)
            self.shown.state = ProjectorState.OPEN

    @rule(how=st.sampled_from(["stop", "close", "unplug"]))
    @precondition(lambda self: self.shown.state is not ProjectorState.CLOSED)
    def leave_projector(self, how: str) -> None:
        if how == "unplug" and self.projector_bench.unplug is not None and self.shown.plugged:
            self.projector_bench.pull()
            self.shown.unplug()
        elif how == "close":
            self.projector.close()
            self.shown.close()
        else:
            self.projector.stop()
            self.shown.stop()

    @rule(which=st.integers(0, 100))
    def call_the_projector_illegally(self, which: int) -> None:
        dead = self.shown.dead
        calls = ("open", "configure", "load", "show") if dead else projector_states.ILLEGAL[self.shown.state]
        with refused(self.projector, *(_LOST if dead else (DeviceStateError,)), keeps_state=not dead):
            projector_states.CALLS[calls[which % len(calls)]](self.projector, self.projector_info)
        if dead:
            assert_state(self.projector, ProjectorState.FAULT)

    @invariant()
    def states_agree(self) -> None:
        state, shown = self.camera.state, self.projector.state
        assert self.model.agrees(state), f"{self.camera.name} is {state}, should be {self.model.state}"
        assert self.shown.agrees(shown), f"{self.projector.name} is {shown}, should be {self.shown.state}"

    def teardown(self) -> None:
        self.camera.close()
        self.projector.close()
        assert_state(self.camera, CameraState.CLOSED)
        assert_state(self.projector, ProjectorState.CLOSED)
        assert_no_new_threads(self.threads, self.bench.patience_s)
