"""Virtual cameras and their projector: times, settings, what is made when."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from painted_source import (
    HELD,
    PERIOD_US,
    PLAN,
    PaintedSource,
    arm,
    close,
    collect,
    frames_of,
    gaps_of,
    ids_of,
    load_and_arm,
    names_of,
    opened,
    run,
)

from drivers.camera import Camera, CameraSettings, EdgeTriggered, SoftwareTriggered, Trigger, supported_triggers
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DeviceLostError, SequenceInvalidError
from drivers.projector import Projector, ProjectorSettings, ProjectorState
from drivers.stage import Stage
from drivers.virtual.camera import READOUT_US, VirtualCamera
from drivers.virtual.rig import bench_of, virtual_rig
from models.patterns import PatternPlan, make_plan


@pytest.fixture
def source() -> PaintedSource:
    return PaintedSource()


@pytest.fixture
def devices(source: PaintedSource) -> Iterator[RigDevices]:
    made = opened(virtual_rig(source, realtime=False))
    yield made
    close(made)


@pytest.fixture
def in_time(source: PaintedSource) -> Iterator[RigDevices]:
    made = opened(virtual_rig(source))
    yield made
    close(made)


def test_they_keep_the_protocols(devices: RigDevices) -> None:
    for camera in devices.cameras.values():
        assert isinstance(camera, Camera)
        assert isinstance(camera, EdgeTriggered)
        assert isinstance(camera, SoftwareTriggered)
        assert supported_triggers(camera) == frozenset(Trigger)
    assert isinstance(devices.projector, Projector)
    assert isinstance(devices.stage, Stage)


def test_a_sequence_gives_each_camera_each_pattern_at_its_time(devices: RigDevices) -> None:
    for got in run(devices).values():
        assert names_of(got) == list(PLAN.names)
        assert ids_of(got) == list(range(1, len(PLAN) + 1))
        assert gaps_of(got) == pytest.approx([PERIOD_US] * (len(PLAN) - 1), rel=3e-5)


def test_the_cameras_clocks_run_apart(devices: RigDevices) -> None:
    """Offsets are arbitrary; the drift shows over a long time and stays small."""
    first = {side: frames_of(got)[0].device_ns for side, got in run(devices).items()}
    for camera in devices.cameras.values():
        camera.disarm()
    bench_of(devices).time.reach(3600e6)
    later = {side: frames_of(got)[0].device_ns for side, got in run(devices).items()}
    assert abs(first["left"] - first["right"]) > 1e9
    elapsed = {side: later[side] - first[side] for side in first}
    apart = abs(elapsed["left"] - elapsed["right"]) / elapsed["left"]
    assert 5e-6 < apart < 50e-6


def test_device_times_go_on_from_sequence_to_sequence(devices: RigDevices) -> None:
    times: list[int] = []
    for _ in range(3):
        times += [f.device_ns for f in frames_of(run(devices)["left"])]
        devices.left.disarm()
        devices.right.disarm()
        devices.left.arm(None, Trigger.FREE_RUN)
        times += [devices.left.wait_frame(1.0).device_ns for _ in range(3)]
        devices.left.disarm()
    assert times == sorted(set(times))


def test_pulses_leave_room_for_exposure_and_dark(devices: RigDevices) -> None:
    loaded = devices.projector.load(PLAN, 8400.0)
    dark_us = devices.projector.info.limits.dark_us
    assert loaded.pulses_us[1] == pytest.approx(8333 + dark_us)
    assert loaded.duration_us == pytest.approx(5 * (8333 + dark_us) + 8333)


@pytest.mark.parametrize("period_us", [float("nan"), float("inf"), -1.0])
def test_an_impossible_period_is_refused(devices: RigDevices, period_us: float) -> None:
    with pytest.raises(SequenceInvalidError):
        devices.projector.load(PLAN, period_us)
    assert devices.projector.state == ProjectorState.OPEN


def test_an_empty_plan_is_refused(devices: RigDevices) -> None:
    with pytest.raises(SequenceInvalidError, match="no patterns"):
        devices.projector.load(PatternPlan(patterns=()), PERIOD_US)


def test_a_busy_camera_ignores_every_second_pulse(devices: RigDevices) -> None:
    """As exposure grows beyond the period, without a gap in the ids."""
    devices.left.configure(CameraSettings(exposure_us=12_000.0))
    got = run(devices)
    assert names_of(got["left"]) == list(PLAN.names[::2])
    assert ids_of(got["left"]) == [1, 2, 3]
    assert gaps_of(got["left"]) == pytest.approx([2 * PERIOD_US] * 2, rel=1e-4)
    assert names_of(got["right"]) == list(PLAN.names)


@pytest.mark.parametrize("exposure_us", [20.0, 2_000.0, 8_333.0, 100_000.0])
def test_the_shortest_period_loses_no_pulse_and_a_shorter_one_does(devices: RigDevices, exposure_us: float) -> None:
    camera = devices.left
    assert isinstance(camera, EdgeTriggered)
    settings = CameraSettings(exposure_us=exposure_us)
    camera.configure(settings)
    least_us = camera.min_period_us(settings)
    assert least_us >= max(exposure_us, READOUT_US)
    plan = make_plan("reference").restricted_to(["white", "gray_00", "gray_01", "black"])
    plan = PatternPlan(patterns=tuple(p.model_copy(update={"exposure_us": 240.0}) for p in plan.patterns[::3]))
    for period_us, frames in ((least_us, 2), (0.99 * least_us, 1)):
        load_and_arm(devices, plan, period_us)
        devices.projector.start()
        assert len(collect(devices)["left"]) == frames
        devices.left.disarm()
        devices.right.disarm()


def test_settings_snap_to_the_cameras_steps_and_read_back(devices: RigDevices) -> None:
    applied = devices.left.configure(CameraSettings(exposure_us=5000.4, gain_db=3.14159))
    assert (applied.exposure_us, applied.gain_db) == (5000.0, 3.1)
    assert devices.left.read_settings() == applied
    assert applied.features["gamma"] == "off"
    with pytest.raises(DeviceConfigurationError, match=r"exposure_us cannot be 10\.0; it takes 20 to 350000 us"):
        devices.left.configure(CameraSettings(exposure_us=10.0))
    with pytest.raises(DeviceConfigurationError, match="bit_depth"):
        devices.left.configure(CameraSettings(bit_depth=12))
    assert devices.left.read_settings() == applied


def test_images_are_made_for_the_settings_in_force_before_the_first_pulse(
    devices: RigDevices, source: PaintedSource
) -> None:
    devices.projector.configure(ProjectorSettings(brightness=0.5))
    devices.projector.load(PLAN, PERIOD_US)
    devices.left.configure(CameraSettings(exposure_us=6000.0))
    devices.right.configure(CameraSettings(exposure_us=9000.0))
    arm(devices)
    made = len(source.asked)
    assert made == 2 * len(PLAN)
    devices.projector.start()
    assert len(source.asked) == made
    for asked in source.asked:
        assert asked.exposure_us == (6000.0 if asked.side == "left" else 9000.0)
        assert asked.lit_us == min(asked.exposure_us, 8333.0)
        assert asked.brightness == 0.5


def test_whatever_changes_after_arming_is_in_the_images(devices: RigDevices, source: PaintedSource) -> None:
    load_and_arm(devices)
    devices.projector.configure(ProjectorSettings(brightness=0.25))
    source.asked.clear()
    devices.projector.start()
    assert {a.brightness for a in source.asked} == {0.25}
    for camera in devices.cameras.values():
        camera.disarm()
    load_and_arm(devices)
    source.place("another")
    source.asked.clear()
    devices.projector.start()
    assert len(source.asked) == 2 * len(PLAN)


def test_each_sequence_is_a_new_shot(devices: RigDevices, source: PaintedSource) -> None:
    """Also where the cameras stay armed and the projector starts twice."""
    load_and_arm(devices)
    devices.projector.start()
    devices.projector.start()
    assert len(collect(devices)["left"]) == 2 * len(PLAN)
    assert [a.shot for a in source.asked if a.side == "left"] == [0] * len(PLAN) + [1] * len(PLAN)


def test_a_plan_that_the_present_scene_lacks_is_not_started(devices: RigDevices, source: PaintedSource) -> None:
    load_and_arm(devices)
    source.stored = PLAN.restricted_to(["white"])
    with pytest.raises(SequenceInvalidError, match="high_00"):
        devices.projector.start()
    assert collect(devices) == {"left": [], "right": []}


def test_the_live_view_shows_what_is_held(devices: RigDevices) -> None:
    devices.left.arm(None, Trigger.FREE_RUN)
    levels = [int(devices.left.wait_frame(1.0).image[0, 8])]
    devices.projector.show(PLAN.patterns[0])
    levels.append(int(devices.left.wait_frame(1.0).image[0, 8]))
    devices.projector.show(None)
    levels.append(int(devices.left.wait_frame(1.0).image[0, 8]))
    assert levels == [1, HELD, 1]
    assert devices.left.disarm().delivered == 3


def test_a_call_takes_one_frame_of_what_is_held(devices: RigDevices) -> None:
    devices.projector.show(PLAN.patterns[0])
    devices.right.arm(1, Trigger.SOFTWARE)
    assert isinstance(devices.right, SoftwareTriggered)
    devices.right.software_trigger()
    frame = devices.right.wait_frame(1.0)
    assert (frame.frame_id, int(frame.image[0, 8])) == (1, HELD)


def test_the_other_camera_works_when_one_is_pulled(devices: RigDevices) -> None:
    assert isinstance(devices.left, VirtualCamera)
    load_and_arm(devices)
    devices.left.unplug()
    devices.projector.start()
    got = collect(devices)
    assert isinstance(got["left"].pop(), DeviceLostError)
    assert got["left"] == []
    assert names_of(got["right"]) == list(PLAN.names)


def test_in_real_time_frames_come_when_they_would(in_time: RigDevices, source: PaintedSource) -> None:
    """Never before exposure and readout are over; device times are exact however late the host is."""
    load_and_arm(in_time)
    started_ns = time.monotonic_ns()
    in_time.projector.start()
    assert in_time.projector.state == ProjectorState.PROJECTING
    frames = [in_time.left.wait_frame(5.0) for _ in PLAN.patterns]
    for k, frame in enumerate(frames):
        assert frame.host_ns - started_ns >= 1000 * (k * PERIOD_US + 8333 + READOUT_US)
        assert frame.host_ns <= time.monotonic_ns()
    assert gaps_of(list(frames)) == pytest.approx([PERIOD_US] * 5, rel=3e-5)
    assert {a.thread for a in source.asked} == {threading.current_thread().name}, "an image was made between pulses"


def test_stopping_ends_the_sequence_between_two_pulses(in_time: RigDevices) -> None:
    load_and_arm(in_time, PLAN, 100_000.0)
    in_time.projector.start()
    in_time.left.wait_frame(5.0)
    in_time.projector.stop()
    assert in_time.projector.state == ProjectorState.LOADED
    sent = bench_of(in_time).pulses_sent
    assert 1 <= sent < len(PLAN)
    assert [len(got) + (side == "left") for side, got in collect(in_time, 0.15).items()] == [sent, sent]


def test_a_camera_may_arm_while_a_sequence_runs(in_time: RigDevices) -> None:
    in_time.projector.load(PLAN, 30_000.0)
    in_time.left.arm(None, Trigger.HARDWARE_EDGE)
    in_time.projector.start()
    in_time.left.wait_frame(5.0)
    in_time.right.arm(None, Trigger.HARDWARE_EDGE)
    got = names_of(collect(in_time, 0.3)["right"])
    assert 0 < len(got) < len(PLAN)
    assert got == list(PLAN.names[-len(got) :])


def test_no_thread_outlives_its_sequence(source: PaintedSource) -> None:
    before = set(threading.enumerate())
    for round_ in range(20):
        devices = opened(virtual_rig(source))
        load_and_arm(devices)
        devices.projector.start()
        if round_ % 4 == 0:
            frames_of([devices.left.wait_frame(5.0) for _ in PLAN.patterns])
        elif round_ % 4 == 1:
            devices.projector.stop()
        elif round_ % 4 == 2:
            devices.left.close()
        close(devices)
        assert set(threading.enumerate()) <= before
