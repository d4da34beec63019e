"""Each planted fault does what it says, to whom it says, as often as it says."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from painted_source import (
    PERIOD_US,
    PLAN,
    WHITE_LEVEL,
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

from drivers.camera import CameraSettings, CameraState, Trigger
from drivers.devices import RigDevices
from drivers.errors import (
    DeviceLostError,
    DeviceNotFoundError,
    FrameTimeoutError,
    IncompleteFrameError,
    ProtocolError,
)
from drivers.projector import ProjectorState
from drivers.virtual.faults import PlantedFault
from drivers.virtual.rig import bench_of, virtual_rig

ALL = list(PLAN.names)
IDS = list(range(1, len(PLAN) + 1))
Make = Callable[..., RigDevices]


@pytest.fixture
def faulty() -> Iterator[Make]:
    """Makes an open rig with one fault."""
    made: list[RigDevices] = []

    def make(kind: str, **settings: Any) -> RigDevices:
        made.append(opened(virtual_rig(PaintedSource(), realtime=False, faults=[PlantedFault(kind, **settings)])))
        return made[-1]

    yield make
    for devices in made:
        close(devices)


def assert_clean(devices: RigDevices) -> None:
    for got in run(devices).values():
        assert names_of(got) == ALL
        assert ids_of(got) == IDS
        assert gaps_of(got) == pytest.approx([PERIOD_US] * (len(PLAN) - 1), rel=1e-4)
    assert all(camera.disarm().lost == 0 for camera in devices.cameras.values())


def disarm(devices: RigDevices) -> None:
    for camera in devices.cameras.values():
        camera.disarm()


def test_a_dropped_frame_leaves_a_gap_in_the_ids_and_is_counted(faulty: Make) -> None:
    devices = faulty("dropped", side="left", index=2)
    got = run(devices)
    assert names_of(got["left"]) == ALL[:2] + ALL[3:]
    assert ids_of(got["left"]) == IDS[:2] + IDS[3:]
    assert ids_of(got["right"]) == IDS
    assert devices.left.disarm().lost == 1
    assert devices.right.disarm().lost == 0
    assert_clean(devices)


def test_an_ignored_pulse_leaves_a_gap_in_time_but_not_in_the_ids(faulty: Make) -> None:
    devices = faulty("ignored", side="right", index=3)
    got = run(devices)
    assert names_of(got["right"]) == ALL[:3] + ALL[4:]
    assert ids_of(got["right"]) == IDS[:-1]
    assert gaps_of(got["right"]) == pytest.approx([PERIOD_US, PERIOD_US, 2 * PERIOD_US, PERIOD_US], rel=1e-4)
    assert devices.right.disarm().lost == 0
    assert names_of(got["left"]) == ALL


def test_a_late_frame_comes_after_its_time_and_holds_those_behind_it_up(faulty: Make) -> None:
    devices = faulty("late", side="left", index=1, delay_s=0.25)
    load_and_arm(devices)
    started = time.monotonic()
    devices.projector.start()
    first = devices.left.wait_frame(0.0)
    with pytest.raises(FrameTimeoutError):
        devices.left.wait_frame(0.0)
    second, third = devices.left.wait_frame(5.0), devices.left.wait_frame(5.0)
    assert [f.frame_id for f in (first, second, third)] == IDS[:3]
    assert second.host_ns >= 1e9 * (started + 0.25)
    assert third.host_ns >= second.host_ns
    assert second.device_ns - first.device_ns == pytest.approx(1000 * PERIOD_US, rel=1e-4)
    assert names_of(collect(devices)["right"]) == ALL


def test_late_frames_that_were_not_awaited_are_lost_and_not_unclaimed(faulty: Make) -> None:
    devices = faulty("late", index=4, delay_s=60.0)
    load_and_arm(devices)
    devices.projector.start()
    statistics = devices.left.disarm()
    assert (statistics.unclaimed, statistics.lost) == (4, 2)


def test_a_doubled_pulse_gives_a_frame_too_many_right_behind(faulty: Make) -> None:
    got = run(faulty("doubled", side="left", index=1))
    assert names_of(got["left"]) == [*ALL[:2], ALL[1], *ALL[2:]]
    assert ids_of(got["left"]) == [*IDS, IDS[-1] + 1]
    gaps = gaps_of(got["left"])
    assert gaps[1] < 0.05 * PERIOD_US
    assert gaps[1] + gaps[2] == pytest.approx(PERIOD_US, rel=1e-4)
    assert names_of(got["right"]) == ALL


@pytest.mark.parametrize("side", ["left", None])
def test_swapped_images_keep_their_ids_and_times(faulty: Make, side: str | None) -> None:
    devices = faulty("swapped", side=side, index=1)
    got = run(devices)
    swapped = [ALL[0], ALL[2], ALL[1], *ALL[3:]]
    assert names_of(got["left"]) == swapped
    assert names_of(got["right"]) == (ALL if side else swapped)
    assert ids_of(got["left"]) == IDS
    assert gaps_of(got["left"]) == pytest.approx([PERIOD_US] * 5, rel=1e-4)


def test_a_truncated_frame_is_told_and_the_next_ones_come(faulty: Make) -> None:
    devices = faulty("truncated", side="right", index=2)
    got = run(devices)["right"]
    error = got.pop(2)
    assert isinstance(error, IncompleteFrameError)
    assert error.index == 2
    assert error.device == "right camera"
    assert ids_of(got) == IDS[:2] + IDS[3:]
    assert devices.right.state == CameraState.ARMED


def test_a_dead_camera_answers_nothing_until_it_is_opened_again(faulty: Make) -> None:
    devices = faulty("dead_camera", side="left", index=3)
    got = run(devices)
    assert isinstance(got["left"].pop(), DeviceLostError)
    assert names_of(got["left"]) == ALL[:3]
    assert names_of(got["right"]) == ALL
    assert devices.left.state == CameraState.FAULT
    for call in (
        devices.left.read_settings,
        lambda: devices.left.wait_frame(0.0),
        lambda: devices.left.arm(1, Trigger.FREE_RUN),
        lambda: devices.left.configure(CameraSettings()),
    ):
        with pytest.raises(DeviceLostError, match="left camera"):
            call()
    devices.left.disarm()
    devices.left.close()
    devices.left.open()
    devices.left.configure(CameraSettings())
    devices.right.disarm()
    assert_clean(devices)


def test_a_camera_that_stays_dead_is_not_found_until_the_fault_is_cleared(faulty: Make) -> None:
    devices = faulty("dead_camera", side="left", sequences=None)
    run(devices)
    devices.left.close()
    for _ in range(3):
        with pytest.raises(DeviceNotFoundError):
            devices.left.open()
    bench_of(devices).clear_faults()
    devices.left.open()


def test_opening_a_dead_camera_uses_the_fault_up(faulty: Make) -> None:
    devices = faulty("dead_camera", side="right", sequences=2)
    run(devices)
    devices.right.close()
    with pytest.raises(DeviceNotFoundError):
        devices.right.open()
    assert devices.right.open().serial == "right-1"


@pytest.mark.parametrize("side", ["left", None])
def test_a_saturated_view_reads_white_wherever_there_is_light(faulty: Make, side: str | None) -> None:
    got = run(faulty("saturated", side=side, index=2))
    assert names_of(got["left"])[:2] == ALL[:2]
    for frame in frames_of(got["left"])[2:]:
        assert (frame.image == WHITE_LEVEL).all()
    saturated = [bool((f.image == WHITE_LEVEL).all()) for f in frames_of(got["right"])]
    assert saturated == [False, False] + [side is None] * 4


def test_without_the_lamp_the_patterns_are_dark(faulty: Make) -> None:
    for got in run(faulty("dark")).values():
        assert max(int(f.image.max()) for f in frames_of(got)) <= 2


def test_something_that_moved_is_seen_elsewhere_from_then_on(faulty: Make) -> None:
    got = run(faulty("moved", side="left", index=4, shift_px=5))
    marks = [int(np.argmax(f.image[0])) for f in frames_of(got["left"])]
    assert marks == [0, 0, 0, 0, 5, 5]
    assert {int(np.argmax(f.image[0])) for f in frames_of(got["right"])} == {0}


def test_a_setting_that_drifted_reads_back_differently(faulty: Make) -> None:
    devices = faulty("drifted", side="right", index=1)
    before = {side: camera.read_settings() for side, camera in devices.cameras.items()}
    got = run(devices)
    assert ids_of(got["right"]) == IDS
    disarm(devices)
    assert devices.left.read_settings() == before["left"]
    assert abs(devices.right.read_settings().exposure_us - before["right"].exposure_us) > 100
    devices.right.configure(CameraSettings())
    assert devices.right.read_settings() == before["right"]


def test_an_early_pulse_comes_before_the_start(faulty: Make) -> None:
    devices = faulty("early", side="left")
    load_and_arm(devices)
    assert devices.left.wait_frame(0.0).frame_id == IDS[0]
    devices.projector.start()
    got = collect(devices)
    assert ids_of(got["left"]) == [i + 1 for i in IDS]
    assert names_of(got["left"]) == names_of(got["right"]) == ALL
    disarm(devices)
    assert_clean(devices)


def test_an_early_pulse_on_both_lines_is_used_up_by_both(faulty: Make) -> None:
    devices = faulty("early")
    arm(devices)
    assert [len(got) for got in collect(devices).values()] == [1, 1]
    disarm(devices)
    arm(devices)
    assert [len(got) for got in collect(devices).values()] == [0, 0]


def test_a_projector_that_does_not_start_sends_nothing(faulty: Make) -> None:
    devices = faulty("not_started")
    assert run(devices) == {"left": [], "right": []}
    assert bench_of(devices).pulses_sent == 0
    assert devices.projector.state == ProjectorState.LOADED
    disarm(devices)
    assert_clean(devices)


def test_a_refused_start_is_told_and_may_be_tried_again(faulty: Make) -> None:
    devices = faulty("start_refused")
    load_and_arm(devices)
    with pytest.raises(ProtocolError, match="projector"):
        devices.projector.start()
    assert devices.projector.state == ProjectorState.LOADED
    assert collect(devices) == {"left": [], "right": []}
    devices.projector.start()
    assert names_of(collect(devices)["left"]) == ALL


def test_a_projector_that_is_gone_must_be_opened_again(faulty: Make) -> None:
    devices = faulty("unplugged")
    with pytest.raises(DeviceLostError):
        devices.projector.load(PLAN, PERIOD_US)
    assert devices.projector.state == ProjectorState.FAULT
    with pytest.raises(DeviceLostError):
        devices.projector.show(None)
    devices.projector.close()
    devices.projector.open()
    assert_clean(devices)


def test_a_projector_that_is_pulled_between_load_and_start_is_lost_at_the_start(faulty: Make) -> None:
    devices = faulty("dropped", index=0)
    load_and_arm(devices)
    bench_of(devices).plant(PlantedFault("unplugged", sequences=2))
    with pytest.raises(DeviceLostError):
        devices.projector.start()
    devices.projector.close()
    with pytest.raises(DeviceNotFoundError):
        devices.projector.open()
    assert devices.projector.open().driver == "painted"
    assert [f.kind for f in bench_of(devices).faults.planted] == ["dropped"], "a start that failed is no sequence"


@pytest.mark.parametrize("sequences", [1, 3])
def test_a_fault_strikes_as_many_sequences_as_it_says(faulty: Make, sequences: int) -> None:
    devices = faulty("dropped", index=0, sequences=sequences)
    for _ in range(sequences):
        assert len(run(devices)["left"]) == len(PLAN) - 1
        disarm(devices)
    assert_clean(devices)


def test_a_fault_for_ever_lasts_until_it_is_cleared(faulty: Make) -> None:
    devices = faulty("ignored", index=0, sequences=None)
    for _ in range(4):
        assert len(run(devices)["right"]) == len(PLAN) - 1
        disarm(devices)
    bench_of(devices).clear_faults()
    assert_clean(devices)


def test_several_faults_strike_together(faulty: Make) -> None:
    devices = faulty("dropped", side="left", index=0)
    bench_of(devices).plant(PlantedFault("swapped", index=2))
    got = run(devices)
    swapped = [ALL[0], ALL[1], ALL[3], ALL[2], *ALL[4:]]
    assert names_of(got["left"]) == swapped[1:]
    assert names_of(got["right"]) == swapped


@pytest.mark.parametrize(
    "settings", [{"kind": "melted"}, {"kind": "late", "index": -1}, {"kind": "dark", "sequences": 0}]
)
def test_an_impossible_fault_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=settings["kind"]):
        PlantedFault(**settings)
