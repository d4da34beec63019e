"""The contract tests fail for drivers that break the contract in one small way each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, settings
from hypothesis.stateful import run_state_machine_as_test
from small_scene import small_source
from virtual_benches import both_benches, camera_bench, projector_bench

from drivers.camera import AppliedSettings, CameraSettings, CameraState, Frame, StreamStatistics, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceLostError, DeviceStateError, DriverError, FrameTimeoutError
from drivers.projector import LoadedSequence, ProjectorState
from drivers.testing import CameraContract, ProjectorContract, camera_machine
from drivers.testing.bench import CameraBench, ProjectorBench
from drivers.virtual.bench import Bench
from drivers.virtual.camera import VirtualCamera
from drivers.virtual.clock import BenchTime
from drivers.virtual.faults import Faults
from drivers.virtual.projector import VirtualProjector
from models.patterns import PatternPlan

FAILURE = (AssertionError, pytest.fail.Exception, DriverError)
EDGE = Trigger.HARDWARE_EDGE


class CountsOn(VirtualCamera):
    """Frame ids go on from one arming to the next."""

    seen = 0

    def wait_frame(self, timeout_s: float) -> Frame:
        frame = super().wait_frame(timeout_s)
        self.seen += 1
        return replace(frame, frame_id=self.seen - 1)


class LendsItsBuffer(VirtualCamera):
    """All frames are one piece of memory."""

    buffer: np.ndarray | None = None

    def wait_frame(self, timeout_s: float) -> Frame:
        frame = super().wait_frame(timeout_s)
        if self.buffer is None:
            self.buffer = frame.image
        self.buffer[...] = frame.image
        return replace(frame, image=self.buffer)


class DeliversLyingDown(VirtualCamera):
    """Images have width and height exchanged."""

    def wait_frame(self, timeout_s: float) -> Frame:
        frame = super().wait_frame(timeout_s)
        return replace(frame, image=frame.image.T)


class StopsAtTheCount(VirtualCamera):
    """Frames beyond those announced are thrown away."""

    left: int | None = None

    def arm(self, frames: int | None, trigger: Trigger) -> None:
        self.left = frames
        super().arm(frames, trigger)

    def wait_frame(self, timeout_s: float) -> Frame:
        if self.left == 0:
            raise FrameTimeoutError(self.name, "no more")
        frame = super().wait_frame(timeout_s)
        self.left = None if self.left is None else self.left - 1
        return frame


class Clips(VirtualCamera):
    """Takes any exposure and holds the nearest it can."""

    def configure(self, settings: CameraSettings) -> AppliedSettings:
        low, high = self.info.limits.exposure_us
        return super().configure(settings.model_copy(update={"exposure_us": min(max(settings.exposure_us, low), high)}))


class GivesUp(VirtualCamera):
    """A time-out disarms it."""

    def wait_frame(self, timeout_s: float) -> Frame:
        try:
            return super().wait_frame(timeout_s)
        except FrameTimeoutError:
            self.disarm()
            raise


class IsImpatient(VirtualCamera):
    """Does not wait for a frame that is not there yet."""

    def wait_frame(self, timeout_s: float) -> Frame:
        return super().wait_frame(0.0)


class Panics(VirtualCamera):
    """Cannot be disarmed once it is dead."""

    def disarm(self) -> StreamStatistics:
        if self.state is CameraState.FAULT:
            raise DeviceLostError(self.name, "gone")
        return super().disarm()


class IsLenient(VirtualCamera):
    """Takes the exclusion of calls by state lightly."""

    def open(self):  # type: ignore[no-untyped-def]
        return self.info if self.state is CameraState.OPEN else super().open()


class IsAnonymous(VirtualCamera):
    """Its errors do not say who speaks."""

    def wait_frame(self, timeout_s: float) -> Frame:
        try:
            return super().wait_frame(timeout_s)
        except DeviceStateError as error:
            raise DeviceStateError("device", "cannot") from error


class LosesAFrame(VirtualCamera):
    """Throws away what it says it delivered."""

    def disarm(self) -> StreamStatistics:
        return replace(super().disarm(), unclaimed=0)


class StaysOpen(VirtualCamera):
    """A second ``close`` is needed while it is armed."""

    def close(self) -> None:
        if self.state is CameraState.ARMED:
            self.disarm()
        else:
            super().close()


def _rig(camera: type[VirtualCamera], projector: type[VirtualProjector], *, realtime: bool) -> RigDevices:
    bench = Bench(small_source(), Faults(), BenchTime(realtime=realtime))
    return RigDevices(camera("left", bench), VirtualCamera("right", bench), projector(bench))


CameraTest = Callable[[CameraContract, VirtualCamera, CameraBench], None]


@pytest.mark.parametrize(
    ("mutant", "test"),
    [
        (CountsOn, lambda c, cam, b: c.test_arming_again_counts_from_the_first_id(cam, b, EDGE)),
        (LendsItsBuffer, lambda c, cam, b: c.test_a_frame_belongs_to_its_receiver(cam, b, EDGE)),
        (DeliversLyingDown, lambda c, cam, b: c.test_frames_come_in_order_and_whole(cam, b, EDGE)),
        (StopsAtTheCount, lambda c, cam, b: c.test_frames_beyond_the_count_are_delivered(cam, b, EDGE)),
        (Clips, lambda c, cam, b: c.test_beyond_a_limit_the_old_settings_stay(cam, b, True)),
        (GivesUp, lambda c, cam, b: c.test_one_exposure_gives_one_frame(cam, b, EDGE)),
        (IsImpatient, lambda c, cam, b: c.test_a_timeout_takes_the_time_asked_and_the_camera_stays_armed(
            cam, b, EDGE, 0.2)),
        (Panics, lambda c, cam, b: c.test_disarm_and_close_never_raise(cam, b, CameraState.ARMED, True)),
        (IsLenient, lambda c, cam, b: c.test_a_call_that_the_state_does_not_allow_changes_nothing(
            cam, b, CameraState.OPEN, "open")),
        (IsAnonymous, lambda c, cam, b: c.test_a_call_that_the_state_does_not_allow_changes_nothing(
            cam, b, CameraState.OPEN, "wait_frame")),
        (LosesAFrame, lambda c, cam, b: c.test_statistics_count_what_was_taken_and_what_was_left(cam, b, EDGE)),
        (StaysOpen, lambda c, cam, b: c.test_close_is_allowed_everywhere_and_open_works_again(
            cam, b, CameraState.ARMED)),
    ],
)  # fmt: skip
def test_a_camera_that_breaks_one_rule_is_found_out(mutant: type[VirtualCamera], test: CameraTest) -> None:
    for kind in (VirtualCamera, mutant):
        bench = camera_bench(_rig(kind, VirtualProjector, realtime=False))
        assert isinstance(bench.camera, VirtualCamera)
        if kind is mutant:
            with pytest.raises(FAILURE):
                test(CameraContract(), bench.camera, bench)
        else:
            test(CameraContract(), bench.camera, bench)


class TakesAnything(VirtualProjector):
    """Fills in exposures that are missing."""

    def load(self, plan: PatternPlan, period_us: float) -> LoadedSequence:
        patterns = [p.model_copy(update={"exposure_us": p.exposure_us or 9000.0}) for p in plan.patterns]
        return super().load(PatternPlan(patterns=tuple(patterns)), period_us)


class HurriesUp(VirtualProjector):
    """Says that pulses come sooner than asked."""

    def load(self, plan: PatternPlan, period_us: float) -> LoadedSequence:
        loaded = super().load(plan, period_us)
        return replace(loaded, pulses_us=tuple(0.9 * t for t in loaded.pulses_us))


class Waits(VirtualProjector):
    """Starts, and returns when all is shown."""

    def start(self) -> None:
        super().start()
        if self._player is not None:
            self._player.join()


class GoesOn(VirtualProjector):
    """A stop changes its state and nothing else."""

    def stop(self) -> None:
        if self._state is ProjectorState.PROJECTING:
            self._state = ProjectorState.LOADED
        else:
            super().stop()


ProjectorTest = Callable[[ProjectorContract, VirtualProjector, ProjectorBench], None]


@pytest.mark.parametrize(
    ("mutant", "test"),
    [
        (TakesAnything, lambda c, p, b: c.test_a_missing_exposure_is_refused_by_name(p)),
        (HurriesUp, lambda c, p, b: c.test_pulses_are_as_many_as_patterns_and_no_closer_than_the_period(p, b, 4, 4.0)),
        (Waits, lambda c, p, b: c.test_start_returns_at_once_and_stop_ends_the_pulses(p, b)),
        (GoesOn, lambda c, p, b: c.test_start_returns_at_once_and_stop_ends_the_pulses(p, b)),
    ],
)
def test_a_projector_that_breaks_one_rule_is_found_out(mutant: type[VirtualProjector], test: ProjectorTest) -> None:
    for kind in (VirtualProjector, mutant):
        bench = projector_bench(_rig(VirtualCamera, kind, realtime=True))
        assert isinstance(bench.projector, VirtualProjector)
        try:
            if kind is mutant:
                with pytest.raises(FAILURE):
                    test(ProjectorContract(), bench.projector, bench)
            else:
                test(ProjectorContract(), bench.projector, bench)
        finally:
            bench.projector.close()


@pytest.mark.parametrize("mutant", [StaysOpen, IsLenient, DeliversLyingDown])
def test_the_random_walk_finds_it_too(mutant: type[VirtualCamera]) -> None:
    machine = camera_machine(lambda: both_benches(_rig(mutant, VirtualProjector, realtime=False)))
    quick = settings(
        machine.TestCase.settings,
        max_examples=500,
        phases=[Phase.generate],
        derandomize=True,
        database=None,
        report_multiple_bugs=False,
    )
    with pytest.raises(FAILURE):
        run_state_machine_as_test(machine, settings=quick)
