"""Hardware-triggered sequences over real sockets: clean ones, and each thing that goes wrong at a pulse."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import numpy as np
import pytest

from drivers.aravis import AravisCamera
from drivers.camera import AppliedSettings, Camera, CameraSettings, CameraState, Frame, StreamStatistics, Trigger
from drivers.errors import DeviceLostError, FrameTimeoutError, IncompleteFrameError
from drivers.genicam import GenicamConfiguration
from drivers.gigevision import SimulatedGrasshopper, TriggerFaults
from drivers.gigevision.__main__ import send_train
from models.capture import Image

PULSES = 24
PATIENCE_S = 3.0


def numbered(index: int, exposure_us: float, gain_db: float) -> Image:
    """A flat image that bears the number of its pulse."""
    del exposure_us, gain_db
    return np.full((480, 640), 10 * (index % 25), np.uint8)


@pytest.fixture
def sensors(aravis: None, address: Callable[[int], str]) -> Iterator[list[SimulatedGrasshopper]]:
    """Two simulated cameras on one trigger line."""
    with ExitStack() as stack:
        yield [stack.enter_context(SimulatedGrasshopper(address(i), f"2049721{i}", numbered)) for i in range(2)]


@pytest.fixture
def cameras(sensors: list[SimulatedGrasshopper]) -> Iterator[list[AravisCamera]]:
    """Both opened and closed again."""
    names = ("left camera", "right camera")
    made = [AravisCamera(name, wired(sensor)) for name, sensor in zip(names, sensors, strict=True)]
    for camera in made:
        camera.open()
    yield made
    for camera in made:
        camera.close()


@pytest.fixture
def camera(cameras: list[AravisCamera]) -> AravisCamera:
    return cameras[0]


def wired(sensor: SimulatedGrasshopper, **more: object) -> GenicamConfiguration:
    return GenicamConfiguration.model_validate({"address": sensor.address, **more})


def ready(camera: Camera, exposure_us: float = 4000.0, frames: int = PULSES) -> AppliedSettings:
    applied = camera.configure(CameraSettings(exposure_us=exposure_us))
    camera.arm(frames, Trigger.HARDWARE_EDGE)
    return applied


def take(camera: Camera, count: int) -> list[Frame]:
    return [camera.wait_frame(PATIENCE_S) for _ in range(count)]


def numbers(frames: list[Frame]) -> list[int]:
    """Which pulse each frame shows."""
    return [int(frame.image[240, 320]) // 10 for frame in frames]


@pytest.mark.parametrize(("rate_hz", "exposure_us"), [(60, 16_000.0), (120, 8000.0)])
def test_two_cameras_at_once_get_every_frame(
    cameras: list[AravisCamera], sensors: list[SimulatedGrasshopper], rate_hz: int, exposure_us: float
) -> None:
    """Each frame shows its own pulse on both, and the device clocks tell the same intervals."""
    for camera in cameras:
        ready(camera, exposure_us)
    with ThreadPoolExecutor(2) as pool:
        taking = [pool.submit(take, camera, PULSES) for camera in cameras]
        send_train(sensors, PULSES, 1e6 / rate_hz)
        pairs = [taken.result() for taken in taking]
    for frames in pairs:
        assert [frame.frame_id for frame in frames] == list(range(PULSES))
        assert numbers(frames) == list(range(PULSES))
        assert all((frame.image == frame.image[0, 0]).all() for frame in frames)
    left, right = (np.diff([frame.device_ns for frame in frames]) * 1e-3 for frames in pairs)
    np.testing.assert_allclose(left, 1e6 / rate_hz, atol=1.0)
    np.testing.assert_allclose(right, left, atol=1.0)
    assert [camera.disarm() for camera in cameras] == [StreamStatistics(PULSES, 0, 0)] * 2


def test_a_receiver_that_comes_late_loses_nothing(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    ready(camera)
    send_train(sensors, PULSES, 8333.0)
    time.sleep(0.1)
    assert numbers(take(camera, PULSES)) == list(range(PULSES))


def test_a_dropped_frame_is_a_gap_in_the_ids(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    sensors[0].plan_faults(TriggerFaults(dropped=frozenset({3})))
    ready(camera)
    send_train(sensors, 6, 8333.0)
    frames = take(camera, 5)
    assert [frame.frame_id for frame in frames] == [0, 1, 2, 4, 5]
    assert numbers(frames) == [0, 1, 2, 4, 5]
    assert camera.disarm() == StreamStatistics(5, 0, 1)


def test_the_first_frame_dropped_is_noticed(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    sensors[0].plan_faults(TriggerFaults(dropped=frozenset({0})))
    ready(camera)
    send_train(sensors, 2, 8333.0)
    assert camera.wait_frame(PATIENCE_S).frame_id == 1
    assert camera.disarm().lost == 1


def test_a_corrupt_frame_is_refused_and_the_others_come(
    camera: AravisCamera, sensors: list[SimulatedGrasshopper]
) -> None:
    sensors[0].plan_faults(TriggerFaults(corrupt=frozenset({2})))
    ready(camera)
    send_train(sensors, 4, 8333.0)
    taken: list[int] = []
    refused: list[IncompleteFrameError] = []
    for _ in range(4):
        try:
            taken.append(camera.wait_frame(PATIENCE_S).frame_id)
        except IncompleteFrameError as error:
            refused.append(error)
    assert taken == [0, 1, 3]
    assert [error.index for error in refused] == [2]
    assert refused[0].status in ("packets are missing", "the rest of it did not come in time")
    assert camera.state is CameraState.ARMED
    assert camera.disarm() == StreamStatistics(3, 0, 0)


def test_a_delayed_frame_comes_late_with_its_own_time(
    camera: AravisCamera, sensors: list[SimulatedGrasshopper]
) -> None:
    sensors[0].plan_faults(TriggerFaults(delayed={1: 0.2}))
    ready(camera)
    send_train(sensors, 2, 8333.0)
    first, late = take(camera, 2)
    assert late.host_ns - first.host_ns > 0.15e9
    assert late.device_ns - first.device_ns < 0.05e9


def test_a_doubled_pulse_gives_a_frame_too_many(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    sensors[0].plan_faults(TriggerFaults(doubled=frozenset({1})))
    ready(camera, frames=3)
    send_train(sensors, 3, 16_667.0)
    frames = take(camera, 4)
    assert [frame.frame_id for frame in frames] == [0, 1, 2, 3]
    assert numbers(frames) == [0, 1, 1, 2]


def test_an_ignored_pulse_shows_in_the_clock_alone(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    sensors[0].plan_faults(TriggerFaults(ignored=frozenset({2})))
    ready(camera)
    send_train(sensors, 5, 20_000.0)
    frames = take(camera, 4)
    assert [frame.frame_id for frame in frames] == [0, 1, 2, 3]
    assert numbers(frames) == [0, 1, 3, 4]
    gaps_us = np.diff([frame.device_ns for frame in frames]) * 1e-3
    np.testing.assert_allclose(gaps_us, [20_000.0, 40_000.0, 20_000.0], atol=1.0)
    with pytest.raises(FrameTimeoutError):
        camera.wait_frame(0.05)


def test_a_camera_that_dies_amid_a_sequence_is_lost_after_its_last_frame(
    cameras: list[AravisCamera], sensors: list[SimulatedGrasshopper]
) -> None:
    """The other one goes on."""
    sensors[0].plan_faults(TriggerFaults(dead_at=2))
    for camera in cameras:
        ready(camera)
    send_train(sensors, 5, 20_000.0)
    assert numbers(take(cameras[0], 2)) == [0, 1]
    with pytest.raises(DeviceLostError):
        cameras[0].wait_frame(10.0)
    assert cameras[0].state is CameraState.FAULT
    assert cameras[0].disarm().delivered == 2
    assert numbers(take(cameras[1], 5)) == [0, 1, 2, 3, 4]


def test_pulses_faster_than_the_exposure_are_lost(camera: AravisCamera, sensors: list[SimulatedGrasshopper]) -> None:
    """Every other pulse falls into the exposure before it, and nothing but the count shows it."""
    ready(camera, exposure_us=12_000.0)
    send_train(sensors, 6, 8333.0)
    assert numbers(take(camera, 3)) == [0, 2, 4]
    with pytest.raises(FrameTimeoutError):
        camera.wait_frame(0.05)


@pytest.mark.parametrize(
    "more", [{"trigger_line": "Line0"}, {"trigger_activation": "FallingEdge"}], ids=["wrong line", "wrong edge"]
)
def test_wired_wrongly_no_frame_comes(sensors: list[SimulatedGrasshopper], more: dict[str, object]) -> None:
    camera = AravisCamera("left camera", wired(sensors[0], **more))
    camera.open()
    ready(camera)
    send_train(sensors, 3, 8333.0)
    with pytest.raises(FrameTimeoutError):
        camera.wait_frame(0.1)
    camera.close()
