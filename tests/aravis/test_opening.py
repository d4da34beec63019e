"""Which camera is opened, and what says that it cannot be."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.aravis import AravisCamera, find_cameras
from drivers.aravis.discovery import privilege
from drivers.camera import CameraSettings, CameraState, Trigger
from drivers.errors import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceUnavailableError,
)
from drivers.genicam import GenicamConfiguration
from drivers.genicam.finding import same_serial
from drivers.gigevision import SimulatedGrasshopper


def camera_of(**configuration: object) -> AravisCamera:
    return AravisCamera("left camera", GenicamConfiguration.model_validate(configuration))


def test_cameras_that_answer_are_listed(aravis: None, address: Callable[[int], str]) -> None:
    """Their serial numbers are no other process's: the library keeps one camera of each."""
    serials = [f"{os.getpid()}{index}" for index in range(2)]
    with SimulatedGrasshopper(address(0), serials[0]), SimulatedGrasshopper(address(1), serials[1]):
        found = {camera.serial: camera for camera in find_cameras() if camera.address in (address(0), address(1))}
    assert set(found) == set(serials)
    for index, serial in enumerate(serials):
        assert found[serial].address == address(index)
        assert found[serial].protocol == "GigEVision"
        assert found[serial].model == "Grasshopper3 GS3-U3-23S6M"
        assert serial in found[serial].id


def test_a_serial_number_finds_its_camera(aravis: None, address: Callable[[int], str]) -> None:
    """As it is printed on the camera or in hexadecimal digits, as the USB shows it."""
    with SimulatedGrasshopper(address(0), "20497299"), SimulatedGrasshopper(address(1), "0138C343"):
        for wanted, serial in (("20497299", "20497299"), ("20497219", "0138C343")):
            camera = camera_of(serial=wanted)
            assert camera.open().serial == serial
            camera.close()
        with pytest.raises(DeviceNotFoundError, match=r"no camera with the serial number 111 .*20497299"):
            camera_of(serial="111").open()


@pytest.mark.parametrize(
    ("wanted", "shown", "same"),
    [
        ("20497219", "20497219", True),
        ("20497219", "0138C343", True),
        ("20497219", "20497210", False),
        ("cam-A", "CAM-a", True),
        ("cam-A", "cam-B", False),
    ],
)
def test_serial_numbers_are_compared_as_people_write_them(wanted: str, shown: str, same: bool) -> None:
    assert same_serial(wanted, shown) is same


def test_an_open_camera_says_what_it_is(grasshopper: SimulatedGrasshopper) -> None:
    """A program on this machine does not pass as a real camera."""
    camera = camera_of(address=grasshopper.address, serial="20497219")
    info = camera.open()
    camera.close()
    assert (info.driver, info.model) == ("aravis", "Point Grey Research Grasshopper3 GS3-U3-23S6M")
    assert (info.serial, info.firmware, info.origin) == ("20497219", "2.23.3.0", "simulated")
    assert (info.size, info.first_frame_id) == ((640, 480), 0)
    assert info.limits.exposure_us == (16.0, 351_828.0)
    assert info.limits.gain_db == (0.0, 29.9)
    assert info.limits.bit_depths == (8, 12)


def test_the_wrong_camera_at_an_address_is_refused_and_let_go(grasshopper: SimulatedGrasshopper) -> None:
    with pytest.raises(DeviceNotFoundError, match="has the serial number 20497219, not 5"):
        camera_of(address=grasshopper.address, serial="5").open()
    assert privilege(grasshopper.address) == 0


def test_nothing_at_an_address(aravis: None, address: Callable[[int], str]) -> None:
    with pytest.raises(DeviceNotFoundError, match="no camera answers at 127"):
        camera_of(address=address(0)).open()


def test_a_camera_that_another_program_controls_is_busy(grasshopper: SimulatedGrasshopper) -> None:
    first, second = camera_of(address=grasshopper.address), camera_of(address=grasshopper.address)
    first.open()
    with pytest.raises(DeviceBusyError, match="another program"):
        second.open()
    first.configure(CameraSettings(exposure_us=2000))
    first.close()
    second.open()
    second.close()


def test_a_camera_that_was_switched_off_and_on_is_lost(grasshopper: SimulatedGrasshopper) -> None:
    """It answers, but it is not ours any more and holds none of our settings."""
    camera = camera_of(address=grasshopper.address)
    camera.open()
    camera.configure(CameraSettings(exposure_us=2000))
    grasshopper.unplug()
    grasshopper.plug()
    with pytest.raises(DeviceLostError):
        camera.arm(1, Trigger.HARDWARE_EDGE)
    camera.close()
    camera.open()
    camera.close()


@pytest.mark.parametrize("state", [CameraState.OPEN, CameraState.CONFIGURED, CameraState.ARMED], ids=str)
def test_a_check_finds_out_that_the_camera_is_gone(grasshopper: SimulatedGrasshopper, state: CameraState) -> None:
    camera = camera_of(address=grasshopper.address)
    camera.check()
    camera.open()
    if state is not CameraState.OPEN:
        camera.configure(CameraSettings(exposure_us=2000))
    if state is CameraState.ARMED:
        camera.arm(1, Trigger.HARDWARE_EDGE)
    camera.check()
    assert camera.state is state
    grasshopper.unplug()
    for _ in range(2):
        with pytest.raises(DeviceLostError):
            camera.check()
        assert camera.state is CameraState.FAULT
    camera.close()
    camera.check()
    assert camera.state is CameraState.CLOSED


def test_after_a_gap_in_the_network_our_own_dead_connection_is_waited_for(grasshopper: SimulatedGrasshopper) -> None:
    """The camera still counts it as its controller, until the library has let go."""
    camera = camera_of(address=grasshopper.address)
    camera.open()
    grasshopper.unplug()
    with pytest.raises(DeviceLostError):
        camera.configure(CameraSettings(exposure_us=2000))
    camera.close()
    time.sleep(0.2)
    grasshopper.plug(kept_power=True)
    camera.open()
    camera.configure(CameraSettings(exposure_us=2000))
    camera.close()


def test_without_its_library_the_package_is_named() -> None:
    camera = camera_of(address="127.0.0.1", library="/nowhere/libaravis.so")
    with pytest.raises(DeviceUnavailableError, match=r"apt-get install libaravis-0\.8-0"):
        camera.open()
    assert camera.state is CameraState.CLOSED


def test_the_environment_names_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARAVIS_LIBRARY", "/nowhere/else.so")
    with pytest.raises(DeviceUnavailableError, match=r"/nowhere/else\.so"):
        find_cameras()


def test_a_foreign_library_is_no_aravis() -> None:
    with pytest.raises(DeviceUnavailableError, match="libc"):
        find_cameras("libc.so.6")


def test_arming_again_and_again_leaves_nothing_behind(
    grasshopper: SimulatedGrasshopper, open_files: Callable[[], int]
) -> None:
    camera = camera_of(address=grasshopper.address)
    camera.open()
    camera.configure(CameraSettings(exposure_us=1000))

    def once() -> None:
        camera.arm(4, Trigger.HARDWARE_EDGE)
        grasshopper.pulse()
        assert camera.wait_frame(3.0).frame_id == 0
        assert camera.disarm().lost == 0

    once()
    files, threads, memory = open_files(), threading.active_count(), resident_kib()
    for _ in range(20):
        once()
    assert open_files() == files
    assert threading.active_count() == threads
    assert resident_kib() - memory < 20 * 8 * 300 // 2, "the buffers of every arming stay"
    camera.close()


def test_opening_again_and_again_leaves_nothing_behind(
    grasshopper: SimulatedGrasshopper, open_files: Callable[[], int]
) -> None:
    camera = camera_of(address=grasshopper.address)
    camera.open()
    camera.close()
    files = open_files()
    for _ in range(10):
        camera.open()
        camera.close()
    assert open_files() == files
    assert privilege(grasshopper.address) == 0


def test_closing_does_not_wait_for_a_dead_camera(grasshopper: SimulatedGrasshopper) -> None:
    camera = camera_of(address=grasshopper.address)
    camera.open()
    camera.configure(CameraSettings(exposure_us=2000))
    camera.arm(4, Trigger.HARDWARE_EDGE)
    grasshopper.unplug()
    start = time.monotonic()
    camera.disarm()
    camera.close()
    assert time.monotonic() - start < 2.0


def resident_kib() -> int:
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def test_a_camera_whose_word_is_not_believed_gets_time(grasshopper: SimulatedGrasshopper) -> None:
    configuration = {"address": grasshopper.address, "ready_by": "settle", "settle_s": 0.3}
    camera = AravisCamera("left camera", GenicamConfiguration.model_validate(configuration))
    try:
        camera.open()
        camera.configure(CameraSettings(exposure_us=2000))
        begun = time.monotonic()
        camera.arm(1, Trigger.HARDWARE_EDGE)
        assert time.monotonic() - begun >= 0.3
        grasshopper.pulse()
        assert camera.wait_frame(5.0).frame_id == 0
    finally:
        camera.close()
