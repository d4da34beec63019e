"""Frames of a camera: one an exposure, in order, whole, and the receiver's own."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from drivers.camera import AppliedSettings, Camera, CameraState, Frame, Trigger
from drivers.errors import DeviceStateError, DriverError, FrameTimeoutError
from drivers.testing.bench import CameraBench, short_settings
from drivers.testing.expect import assert_state, check_message, refused

FRAMES = 4
_SILENCE_S = 0.15
"""How long a camera is watched to say that it sends nothing."""


class CameraFrames:
    """What ``arm``, ``wait_frame`` and ``disarm`` promise."""

    @pytest.fixture(params=list(Trigger), ids=str)
    def trigger(self, request: pytest.FixtureRequest, bench: CameraBench) -> Trigger:
        """Each trigger that the camera takes and the bench can give."""
        return _available(bench, Trigger(request.param))

    @pytest.fixture(params=[Trigger.HARDWARE_EDGE, Trigger.SOFTWARE], ids=str)
    def asked_trigger(self, request: pytest.FixtureRequest, bench: CameraBench) -> Trigger:
        """Each trigger under which the bench decides when a frame comes."""
        return _available(bench, Trigger(request.param))

    def test_frames_come_in_order_and_whole(self, camera: Camera, bench: CameraBench, trigger: Trigger) -> None:
        applied = bench.armed(trigger, FRAMES)
        before = time.monotonic_ns()
        bench.fire(trigger, FRAMES)
        frames = [camera.wait_frame(bench.patience_s) for _ in range(FRAMES)]
        assert_state(camera, CameraState.ARMED)
        check_sequence(frames, camera.info.first_frame_id)
        for frame in frames:
            check_frame(frame, applied)
            assert before <= frame.host_ns <= time.monotonic_ns()

    def test_one_exposure_gives_one_frame(self, camera: Camera, bench: CameraBench, asked_trigger: Trigger) -> None:
        bench.armed(asked_trigger, FRAMES)
        for _ in range(2):
            bench.fire(asked_trigger)
            camera.wait_frame(bench.patience_s)
            with refused(camera, FrameTimeoutError):
                camera.wait_frame(_SILENCE_S)

    def test_every_bit_depth_has_its_pixels(self, camera: Camera, bench: CameraBench, asked_trigger: Trigger) -> None:
        limits = camera.open().limits
        for depth in limits.bit_depths:
            applied = camera.configure(short_settings(limits).model_copy(update={"bit_depth": depth}))
            camera.arm(1, asked_trigger)
            bench.fire(asked_trigger)
            check_frame(camera.wait_frame(bench.patience_s), applied)
            camera.disarm()

    def test_frames_beyond_the_count_are_delivered(
        self, camera: Camera, bench: CameraBench, asked_trigger: Trigger
    ) -> None:
        bench.armed(asked_trigger, frames=2)
        bench.fire(asked_trigger, 4)
        frames = [camera.wait_frame(bench.patience_s) for _ in range(4)]
        check_sequence(frames, camera.info.first_frame_id)

    def test_arming_again_counts_from_the_first_id(
        self, camera: Camera, bench: CameraBench, asked_trigger: Trigger
    ) -> None:
        """Each time the very first exposure after ``arm`` is seen, and the device's clock runs on."""
        bench.configured()
        clock = []
        for _ in range(8):
            camera.arm(1, asked_trigger)
            bench.fire(asked_trigger)
            frame = camera.wait_frame(bench.patience_s)
            assert frame.frame_id == camera.info.first_frame_id
            clock.append(frame.device_ns)
            camera.disarm()
        assert clock == sorted(set(clock))

    def test_arming_discards_what_was_left(self, camera: Camera, bench: CameraBench, asked_trigger: Trigger) -> None:
        bench.armed(asked_trigger)
        bench.fire(asked_trigger, 3)
        camera.disarm()
        camera.arm(1, asked_trigger)
        with refused(camera, FrameTimeoutError):
            camera.wait_frame(_SILENCE_S)

    def test_a_frame_belongs_to_its_receiver(self, camera: Camera, bench: CameraBench, asked_trigger: Trigger) -> None:
        """Neither does the camera write into it later, nor does writing into it reach a later frame."""
        applied = bench.armed(asked_trigger)
        bench.fire(asked_trigger)
        frame = camera.wait_frame(bench.patience_s)
        assert frame.image.flags.writeable
        marked = np.indices(frame.image.shape).sum(axis=0) % 2 * applied.white_level
        frame.image[...] = marked
        bench.fire(asked_trigger, FRAMES)
        later = [camera.wait_frame(bench.patience_s) for _ in range(FRAMES)]
        camera.disarm()
        assert (frame.image == marked).all()
        for other in later:
            assert not np.shares_memory(frame.image, other.image)
            assert (other.image != marked).any()

    def test_pulses_pass_a_camera_that_is_not_armed(self, camera: Camera, bench: CameraBench) -> None:
        if bench.pulse is None or not bench.has(Trigger.HARDWARE_EDGE):
            pytest.skip("no pulses here")
        bench.pulse()
        bench.configured()
        bench.pulse()
        camera.arm(1, Trigger.HARDWARE_EDGE)
        with refused(camera, FrameTimeoutError):
            camera.wait_frame(_SILENCE_S)
        camera.disarm()
        bench.pulse()
        camera.arm(1, Trigger.HARDWARE_EDGE)
        with refused(camera, FrameTimeoutError):
            camera.wait_frame(_SILENCE_S)

    @pytest.mark.parametrize("other", [Trigger.SOFTWARE, Trigger.FREE_RUN], ids=str)
    def test_pulses_are_counted_only_under_the_hardware_trigger(
        self, camera: Camera, bench: CameraBench, other: Trigger
    ) -> None:
        if bench.pulse is None or not bench.has(other):
            pytest.skip(f"no pulses or no {other} here")
        bench.armed(other)
        if other is Trigger.SOFTWARE:
            bench.pulse()
            with refused(camera, FrameTimeoutError):
                camera.wait_frame(_SILENCE_S)
        else:
            camera.wait_frame(bench.patience_s)
            camera.disarm()
            camera.arm(None, Trigger.HARDWARE_EDGE)
            with refused(camera, FrameTimeoutError):
                camera.wait_frame(_SILENCE_S)

    @pytest.mark.parametrize("timeout_s", [0.0, 0.2])
    def test_a_timeout_takes_the_time_asked_and_the_camera_stays_armed(
        self, camera: Camera, bench: CameraBench, asked_trigger: Trigger, timeout_s: float
    ) -> None:
        bench.armed(asked_trigger)
        start = time.monotonic()
        with refused(camera, FrameTimeoutError):
            camera.wait_frame(timeout_s)
        took = time.monotonic() - start
        assert 0.9 * timeout_s <= took <= timeout_s + bench.patience_s / 5
        bench.fire(asked_trigger)
        assert camera.wait_frame(bench.patience_s).frame_id == camera.info.first_frame_id

    def test_running_freely_frames_come_by_themselves_until_disarmed(self, camera: Camera, bench: CameraBench) -> None:
        applied = bench.armed(Trigger.FREE_RUN)
        frames = [camera.wait_frame(bench.patience_s) for _ in range(3)]
        for frame in frames:
            check_frame(frame, applied)
        camera.disarm()
        with refused(camera, DeviceStateError):
            camera.wait_frame(_SILENCE_S)
        camera.arm(None, bench.quiet_trigger())
        with refused(camera, FrameTimeoutError):
            camera.wait_frame(_SILENCE_S)

    def test_statistics_count_what_was_taken_and_what_was_left(
        self, camera: Camera, bench: CameraBench, asked_trigger: Trigger
    ) -> None:
        bench.configured()
        for fired, taken in ((3, 1), (2, 2), (0, 0)):
            camera.arm(fired, asked_trigger)
            bench.fire(asked_trigger, fired)
            for _ in range(taken):
                camera.wait_frame(bench.patience_s)
            time.sleep(_SILENCE_S)
            statistics = camera.disarm()
            assert (statistics.delivered, statistics.unclaimed, statistics.lost) == (taken, fired - taken, 0)

    @pytest.mark.parametrize("after", [CameraState.CONFIGURED, CameraState.CLOSED], ids=["disarm", "close"])
    def test_a_waiting_thread_is_woken(self, camera: Camera, bench: CameraBench, after: CameraState) -> None:
        bench.armed(bench.quiet_trigger())
        waiting = Waiting(camera)
        if after is CameraState.CLOSED:
            camera.close()
        else:
            camera.disarm()
        check_message(camera, waiting.outcome(bench.patience_s))
        assert_state(camera, after)


def _available(bench: CameraBench, trigger: Trigger) -> Trigger:
    if not bench.has(trigger):
        pytest.skip(f"no {trigger} here")
    return trigger


class Waiting:
    """A thread that waits for a frame and keeps the error that ends the wait."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._ended: list[DriverError | None] = []
        self._thread = threading.Thread(target=self._wait, daemon=True)
        self._thread.start()
        time.sleep(0.1)
        assert not self._ended, "the wait ended before anything happened"

    def _wait(self) -> None:
        try:
            self._camera.wait_frame(60.0)
        except DriverError as error:
            self._ended.append(error)
        else:
            self._ended.append(None)

    def outcome(self, patience_s: float) -> DriverError:
        """The error that ended the wait."""
        self._thread.join(patience_s)
        assert not self._thread.is_alive(), "the thread in wait_frame was not woken"
        assert self._ended, "wait_frame ended with an error that is no DriverError"
        error = self._ended[0]
        assert error is not None, "a frame came that nobody asked for"
        return error


def check_frame(frame: Frame, applied: AppliedSettings) -> None:
    """Shape, type and values of the pixels, and the settings that the frame bears."""
    assert frame.image.shape == applied.size[::-1]
    assert frame.image.dtype == (np.uint8 if applied.bit_depth == 8 else np.uint16)
    assert frame.image.max() <= applied.white_level
    assert frame.exposure_us == pytest.approx(applied.exposure_us)
    assert frame.gain_db == pytest.approx(applied.gain_db)


def check_sequence(frames: list[Frame], first_id: int) -> None:
    """Ids count up from the first, and both clocks run forward."""
    assert [frame.frame_id for frame in frames] == list(range(first_id, first_id + len(frames)))
    exposed = [frame.device_ns for frame in frames]
    assert exposed == sorted(set(exposed)), "frames were exposed at the same time or out of order"
    arrived = [frame.host_ns for frame in frames]
    assert arrived == sorted(arrived)
