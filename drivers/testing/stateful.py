"""A random walk of calls over a camera and the projector that triggers it, compared with a model of the diagrams.

Hypothesis chooses the calls, and shortens a walk that failed to the few calls that matter.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from drivers.camera import CameraSettings, CameraState, EdgeTriggered, Trigger, supported_triggers
from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceStateError,
    DriverError,
    FrameTimeoutError,
    SequenceInvalidError,
)
from drivers.projector import ProjectorState
from drivers.testing.bench import CameraBench, ProjectorBench, short_settings
from drivers.testing.camera_frames import Waiting, check_frame
from drivers.testing.camera_model import CameraModel
from drivers.testing.camera_settings import beyond
from drivers.testing.expect import assert_no_new_threads, assert_state, check_message, refused, wait_until
from drivers.testing.projector_plans import showable, with_exposure

MakeBenches = Callable[[], tuple[CameraBench, ProjectorBench]]
_LOST = (DeviceLostError, DeviceStateError)
_OPEN_STATES = (CameraState.OPEN, CameraState.CONFIGURED)
_READY = (ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING)


def camera_machine(make_benches: MakeBenches) -> type[RuleBasedStateMachine]:
    """The random walk over benches that share one trigger line; ``.TestCase`` of what it returns is the test.

    make_benches: called once a walk; its camera and projector are closed. The camera must take hardware pulses.
    """

    class CameraAndProjector(_Walk):
        def __init__(self) -> None:
            super().__init__(*make_benches())

    CameraAndProjector.TestCase.settings = settings(
        max_examples=25,
        stateful_step_count=30,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    return CameraAndProjector


class _Walk(RuleBasedStateMachine):
    """One walk. ``self.model`` is the camera as it should be; the projector's model is its state and loaded plan."""

    def __init__(self, camera_bench: CameraBench, projector_bench: ProjectorBench) -> None:
        super().__init__()
        self.threads = set(threading.enumerate())
        self.bench, self.projector_bench = camera_bench, projector_bench
        self.camera, self.projector = camera_bench.camera, projector_bench.projector
        self.model = CameraModel()
        self.projector_state = ProjectorState.CLOSED
        self.projector_dead, self.projector_plugged = False, True
        self.patterns = 0

    @initialize()
    def learn_limits(self) -> None:
        """Limits of both devices, and a period at which the camera loses no pulse."""
        self.info, self.projector_info = self.camera.open(), self.projector.open()
        assert isinstance(self.camera, EdgeTriggered)
        short = short_settings(self.info.limits)
        longer = short.model_copy(update={"exposure_us": min(1.5 * short.exposure_us, self.info.limits.exposure_us[1])})
        self.choices = (short, longer)
        self.period_us = max(
            self.projector_info.limits.exposure_us[0], *(1.01 * self.camera.min_period_us(c) for c in self.choices)
        )
        self.camera.close()
        self.projector.close()

    # The camera's calls.

    def _may(self, *states: CameraState) -> bool:
        """Whether the camera's call is allowed."""
        return self.model.allows(*states)

    def _refused(self, call: Callable[[], object]) -> None:
        kinds: tuple[type[DriverError], ...] = _LOST if self.model.dead else (DeviceStateError,)
        with refused(self.camera, *kinds, keeps_state=not self.model.dead):
            call()

    @rule()
    def open(self) -> None:
        if not self._may(CameraState.CLOSED):
            self._refused(self.camera.open)
        elif self.model.plugged:
            assert self.camera.open() == self.info
            self.model.state = CameraState.OPEN
        else:
            with refused(self.camera, DriverError):
                self.camera.open()

    @rule(choice=st.sampled_from([0, 1]))
    def configure(self, choice: int) -> None:
        if not self._may(*_OPEN_STATES):
            self._refused(lambda: self.camera.configure(self.choices[choice]))
            return
        self.model.applied = self.camera.configure(self.choices[choice])
        self.model.state = CameraState.CONFIGURED

    @rule(data=st.data())
    def configure_beyond_a_limit(self, data: st.DataObject) -> None:
        if not self._may(*_OPEN_STATES):
            return
        asked: CameraSettings = data.draw(st.sampled_from([asked for _, asked in beyond(self.info.limits)]))
        with refused(self.camera, DeviceConfigurationError):
            self.camera.configure(asked)

    @rule()
    def read_settings(self) -> None:
        if self._may(CameraState.CONFIGURED, CameraState.ARMED):
            assert self.camera.read_settings() == self.model.applied
        else:
            self._refused(self.camera.read_settings)

    @rule(data=st.data(), frames=st.sampled_from([None, 1, 5]))
    def arm(self, data: st.DataObject, frames: int | None) -> None:
        trigger = data.draw(st.sampled_from(sorted(supported_triggers(self.camera))))
        if self._may(CameraState.CONFIGURED):
            self.camera.arm(frames, trigger)
            self.model.armed(trigger)
        else:
            self._refused(lambda: self.camera.arm(frames, trigger))

    @rule(count=st.integers(1, 3))
    @precondition(lambda self: self.bench.pulse is not None and not self.model.dead)
    def pulse(self, count: int) -> None:
        for _ in range(count):
            if self._may(CameraState.CONFIGURED, CameraState.ARMED):
                self.bench.fire(Trigger.HARDWARE_EDGE)
            elif self.bench.pulse is not None:
                self.bench.pulse()
        self.model.exposed(Trigger.HARDWARE_EDGE, count)

    @rule()
    @precondition(lambda self: self.bench.has(Trigger.SOFTWARE))
    def software_trigger(self) -> None:
        if self._may(CameraState.ARMED) and self.model.trigger is Trigger.SOFTWARE:
            self.bench.fire(Trigger.SOFTWARE)
            self.model.exposed(Trigger.SOFTWARE)
        else:
            self._refused(self.camera.software_trigger)  # type: ignore[attr-defined]

    @rule()
    def wait_frame(self) -> None:
        if not self._may(CameraState.ARMED):
            self._refused(lambda: self.camera.wait_frame(self.bench.patience_s))
        elif self.model.trigger is Trigger.FREE_RUN or self.model.pending:
            frame = self.camera.wait_frame(self.bench.patience_s)
            assert self.model.applied is not None
            check_frame(frame, self.model.applied)
            if self.model.trigger is not Trigger.FREE_RUN:
                assert frame.frame_id == self.info.first_frame_id + self.model.taken
                self.model.pending -= 1
            self.model.taken += 1
        else:
            with refused(self.camera, FrameTimeoutError):
                self.camera.wait_frame(0.02)

    @rule()
    def disarm(self) -> None:
        statistics = self.camera.disarm()
        if self._may(CameraState.ARMED):
            assert statistics.delivered == self.model.taken
            if self.model.trigger is not Trigger.FREE_RUN:
                assert statistics.unclaimed <= self.model.pending
        self.model.disarmed()

    @rule(closing=st.booleans())
    @precondition(lambda self: self._may(CameraState.ARMED) and self.model.trigger is not Trigger.FREE_RUN)
    @precondition(lambda self: self.model.pending == 0)
    def cancel_while_another_thread_waits(self, closing: bool) -> None:
        waiting = Waiting(self.camera)
        if closing:
            self.close()
        else:
            self.disarm()
        check_message(self.camera, waiting.outcome(self.bench.patience_s))

    @rule()
    def close(self) -> None:
        self.camera.close()
        self.model.closed()

    @rule()
    @precondition(lambda self: self.bench.unplug is not None and self.model.plugged)
    def unplug(self) -> None:
        self.bench.pull()
        self.model.unplugged()

    @rule()
    @precondition(lambda self: not self.model.plugged and self.model.state is CameraState.CLOSED)
    def plug(self) -> None:
        self.bench.replug()
        self.model.plugged = True

    # The projector's calls.

    def _projector_refused(self, call: Callable[[], object]) -> None:
        kinds: tuple[type[DriverError], ...] = _LOST if self.projector_dead else (DeviceStateError,)
        with refused(self.projector, *kinds, keeps_state=not self.projector_dead):
            call()

    def _projector_may(self, *states: ProjectorState) -> bool:
        return not self.projector_dead and self.projector_state in states

    @rule()
    def open_projector(self) -> None:
        if not self._projector_may(ProjectorState.CLOSED):
            self._projector_refused(self.projector.open)
        elif self.projector_plugged:
            assert self.projector.open() == self.projector_info
            self.projector_state = ProjectorState.OPEN
        else:
            with refused(self.projector, DriverError):
                self.projector.open()

    @rule(count=st.integers(1, 3))
    def load(self, count: int) -> None:
        plan = showable(self.projector_info, count)
        if self._projector_may(*_READY):
            loaded = self.projector.load(plan, self.period_us)
            self.projector_state, self.patterns = ProjectorState.LOADED, len(loaded.plan)
        else:
            self._projector_refused(lambda: self.projector.load(plan, self.period_us))

    @rule()
    @precondition(lambda self: self._projector_may(ProjectorState.OPEN))
    def load_without_an_exposure(self) -> None:
        plan = with_exposure(showable(self.projector_info, 2), 0, None)
        with refused(self.projector, SequenceInvalidError):
            self.projector.load(plan, self.period_us)

    @rule(ending=st.sampled_from(["all shown", "stop", "close", "unplug"]))
    def start(self, ending: str) -> None:
        """Start; whatever ends the sequence, the camera saw as many pulses as the trigger line."""
        if not self._projector_may(ProjectorState.LOADED):
            self._projector_refused(self.projector.start)
            return
        before = self.projector_bench.pulses()
        self.projector.start()
        if ending == "stop":
            self.stop_projector()
        elif ending == "close":
            self.close_projector()
        elif ending == "unplug" and self.projector_bench.unplug is not None:
            self.unplug_projector()
            self.close_projector()
        else:
            patience_s = self.projector_bench.patience_s
            assert wait_until(lambda: self.projector.state != ProjectorState.PROJECTING, patience_s)
            assert self.projector_bench.pulses() - before == self.patterns
        self.model.exposed(Trigger.HARDWARE_EDGE, self.projector_bench.pulses() - before)

    @rule(dark=st.booleans())
    def show(self, dark: bool) -> None:
        pattern = None if dark else showable(self.projector_info, 1).patterns[0]
        if not self._projector_may(*_READY):
            self._projector_refused(lambda: self.projector.show(pattern))
        elif not dark:
            self.projector.show(pattern)
            self.projector_state = ProjectorState.HOLDING
        elif self.projector_state is ProjectorState.HOLDING:
            self.projector.show(None)
            self.projector_state = ProjectorState.OPEN

    @rule()
    def stop_projector(self) -> None:
        self.projector.stop()
        if self.projector_state is ProjectorState.HOLDING:
            self.projector_state = ProjectorState.OPEN

    @rule()
    def close_projector(self) -> None:
        self.projector.close()
        self.projector_state, self.projector_dead = ProjectorState.CLOSED, False

    @rule()
    @precondition(lambda self: self.projector_bench.unplug is not None and self.projector_plugged)
    def unplug_projector(self) -> None:
        self.projector_bench.pull()
        self.projector_plugged = False
        self.projector_dead = self.projector_state is not ProjectorState.CLOSED

    @rule()
    @precondition(lambda self: not self.projector_plugged and self.projector_state is ProjectorState.CLOSED)
    def plug_projector(self) -> None:
        self.projector_bench.replug()
        self.projector_plugged = True

    @invariant()
    def states_agree(self) -> None:
        state = self.camera.state
        assert self.model.agrees(state), f"{self.camera.name} is {state}, should be {self.model.state}"
        shown = self.projector.state
        known_dead = self.projector_dead and shown == ProjectorState.FAULT
        assert known_dead or shown == self.projector_state, (
            f"{self.projector.name} is {shown}, should be {self.projector_state}"
        )

    def teardown(self) -> None:
        self.camera.close()
        self.projector.close()
        assert_state(self.camera, CameraState.CLOSED)
        assert_state(self.projector, ProjectorState.CLOSED)
        assert_no_new_threads(self.threads, self.bench.patience_s)
