"""What Spinnaker asks of its users: the system released once, images given back, nothing of it held."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import pytest
from fake_pyspin import FakeDevice, FakePySpin
from fake_pyspin_nodes import DENIED, IN_USE, IO

from drivers.aravis import AravisCamera
from drivers.camera import Camera, CameraSettings, CameraState, Trigger
from drivers.errors import (
    DeviceBusyError,
    DeviceConfigurationError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceUnavailableError,
    DriverError,
    IncompleteFrameError,
)
from drivers.genicam import GenicamConfiguration
from drivers.gigevision.features import Feature
from drivers.hardware import CamerasConfiguration, hardware_rig, make_camera
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.spinnaker import SpinnakerCamera, find_cameras
from models.geometry.rig import SIDES

SHORT = CameraSettings(exposure_us=2000)
Make = Callable[..., SpinnakerCamera]


def camera_of(device: FakeDevice, **more: object) -> SpinnakerCamera:
    return SpinnakerCamera("left camera", GenicamConfiguration.model_validate({"serial": device.serial, **more}))


def armed(camera: Camera, frames: int | None = 4, trigger: Trigger = Trigger.HARDWARE_EDGE) -> None:
    camera.open()
    camera.configure(SHORT)
    camera.arm(frames, trigger)


def send(device: FakeDevice, count: int) -> None:
    for _ in range(count):
        device.pulse()
        time.sleep(0.006)


def test_the_system_is_released_after_the_last_camera_and_made_again(pyspin: FakePySpin) -> None:
    left, right = (camera_of(device) for device in pyspin.devices)
    for times in (1, 2):
        left.open()
        right.open()
        assert pyspin.made == times
        left.close()
        assert pyspin.released == times - 1
        right.close()
        assert (pyspin.made, pyspin.released) == (times, times)


def test_an_error_that_is_kept_keeps_nothing_of_the_library(pyspin: FakePySpin, device: FakeDevice) -> None:
    """A caller closes the camera while it handles the error: its frames still hold their variables."""
    camera = camera_of(device)
    kept: list[DriverError] = []
    armed(camera)
    device.pulse()
    camera.wait_frame(1.0)
    device.unplug()
    try:
        camera.wait_frame(1.0)
    except DeviceLostError as error:
        kept.append(error)
        camera.close()
        assert pyspin.released == 1
    device.plug()
    device.init_error = IO
    try:
        camera.open()
    except DriverError as error:
        kept.append(error)
    device.init_error, device.begin_error = 0, IO
    camera.open()
    camera.configure(SHORT)
    try:
        camera.arm(1, Trigger.SOFTWARE)
    except DriverError as error:
        kept.append(error)
        camera.close()
    assert pyspin.released == pyspin.made == 3
    assert len(kept) == 3


def test_an_image_that_cannot_be_read_is_given_back_too(pyspin: FakePySpin, device: FakeDevice) -> None:
    camera = camera_of(device)
    device.unreadable = {0}
    armed(camera)
    send(device, 2)
    try:
        camera.wait_frame(1.0)
    except DeviceLostError:
        camera.close()
        assert pyspin.released == 1
    assert [image.releases for image in device.images] == [1, 1]


@pytest.mark.parametrize("ending", ["disarm", "close", "unplug"])
def test_each_image_is_given_back_once(device: FakeDevice, ending: str) -> None:
    """Taken ones, incomplete ones, and those that nobody asked for."""
    camera = camera_of(device)
    device.incomplete = {1: 3}
    armed(camera, 6)
    send(device, 4)
    camera.wait_frame(1.0)
    with pytest.raises(IncompleteFrameError):
        camera.wait_frame(1.0)
    if ending == "disarm":
        assert camera.disarm().unclaimed == 2
    if ending == "unplug":
        device.unplug()
    camera.close()
    assert len(device.images) >= 2
    assert [image.releases for image in device.images] == [1] * len(device.images)


def test_an_incomplete_frame_is_named_and_the_others_come(device: FakeDevice) -> None:
    camera = camera_of(device)
    device.incomplete = {1: 9, 2: 99}
    armed(camera)
    send(device, 4)
    assert camera.wait_frame(1.0).frame_id == 0
    for index, status in ((1, "the rest of it did not come in time"), (2, "status 99")):
        with pytest.raises(IncompleteFrameError) as caught:
            camera.wait_frame(1.0)
        assert (caught.value.index, caught.value.status) == (index, status)
    assert camera.state is CameraState.ARMED
    assert camera.wait_frame(1.0).frame_id == 3
    assert camera.disarm().lost == 0
    camera.close()


def test_an_image_of_another_format_is_no_frame(device: FakeDevice) -> None:
    camera = camera_of(device)
    armed(camera)
    device.nodes.features["PixelFormat"] = Feature("PixelFormat", "enumeration", entries=("RGB8", "Mono16"))
    send(device, 1)
    with pytest.raises(IncompleteFrameError, match="its format is wrong"):
        camera.wait_frame(1.0)
    camera.close()


def test_a_frame_that_never_came_is_counted(device: FakeDevice) -> None:
    camera = camera_of(device)
    device.dropped = {0, 2}
    armed(camera, 5)
    send(device, 5)
    assert [camera.wait_frame(1.0).frame_id for _ in range(3)] == [1, 3, 4]
    assert camera.disarm().lost == 2
    camera.close()


def test_ids_of_a_camera_on_the_network_count_from_zero_too(pyspin: FakePySpin) -> None:
    pyspin.devices.append(device := FakeDevice("5", "192.0.2.7"))
    camera = SpinnakerCamera("left camera", GenicamConfiguration.model_validate({"address": "192.0.2.7"}))
    armed(camera)
    send(device, 2)
    assert [camera.wait_frame(1.0).frame_id for _ in range(2)] == [0, 1]
    camera.close()
    for wrong, why in (({"address": "192.0.2.8"}, "no camera answers at 192.0.2.8"), ({"serial": "6"}, "number 6")):
        asked = GenicamConfiguration.model_validate({"address": "192.0.2.7", **wrong})
        with pytest.raises(DeviceNotFoundError, match=why):
            SpinnakerCamera("left camera", asked).open()


def test_frames_wait_for_a_receiver_that_comes_late(device: FakeDevice) -> None:
    """All of them, and the extra ones, in the order of their exposure."""
    camera = camera_of(device)
    armed(camera, 8)
    send(device, 12)
    assert [camera.wait_frame(1.0).frame_id for _ in range(12)] == list(range(12))
    assert device.stream_nodes.entry("StreamBufferHandlingMode") == "OldestFirst"
    camera.close()


def test_more_frames_than_the_library_holds_are_refused(device: FakeDevice) -> None:
    camera = camera_of(device)
    camera.open()
    camera.configure(SHORT)
    with pytest.raises(DeviceConfigurationError, match="frames cannot be 497; Spinnaker holds at most 500"):
        camera.arm(497, Trigger.HARDWARE_EDGE)
    assert camera.state is CameraState.CONFIGURED
    camera.arm(496, Trigger.HARDWARE_EDGE)
    camera.close()


def test_too_little_memory_for_the_usb_is_told_with_its_cure(device: FakeDevice) -> None:
    camera = camera_of(device)
    device.begin_error = IO
    with pytest.raises(DeviceConfigurationError, match=r"usbfs .*write 1000 into /sys/\S+/usbfs_memory_mb$"):
        armed(camera)
    assert camera.state is CameraState.CONFIGURED
    device.begin_error = 0
    camera.arm(4, Trigger.HARDWARE_EDGE)
    camera.close()


def test_a_camera_that_is_removed_amid_a_sequence_is_lost_after_its_last_frame(device: FakeDevice) -> None:
    camera = camera_of(device)
    armed(camera)
    send(device, 2)
    device.unplug()
    assert [camera.wait_frame(1.0).frame_id for _ in range(2)] == [0, 1]
    with pytest.raises(DeviceLostError):
        camera.wait_frame(2.0)
    assert camera.state is CameraState.FAULT
    assert camera.disarm().delivered == 2
    camera.close()


def test_a_stream_that_breaks_off_on_a_living_camera_is_a_fault(device: FakeDevice) -> None:
    camera = camera_of(device)
    armed(camera)
    device.acquiring = False
    with pytest.raises(DeviceLostError, match=r"stream of frames broke off .*not streaming"):
        camera.wait_frame(1.0)
    assert camera.state is CameraState.FAULT
    camera.close()


def test_a_cached_value_is_no_sign_of_life(device: FakeDevice) -> None:
    camera = camera_of(device)
    camera.open()
    assert device.nodes.cache["Width"] == 640
    device.unplug()
    with pytest.raises(DeviceLostError):
        camera.check()
    camera.close()


@pytest.mark.parametrize("shown", ["20497219", "0138C343"])
def test_a_serial_number_finds_its_camera(pyspin: FakePySpin, shown: str) -> None:
    pyspin.devices[0] = FakeDevice(shown)
    camera = SpinnakerCamera("left camera", GenicamConfiguration(serial="20497219"))
    info = camera.open()
    assert (info.driver, info.serial, info.origin) == ("spinnaker", shown, "real")
    assert (info.model, info.firmware) == ("Point Grey Research Grasshopper3 GS3-U3-23S6M", "2.23.3.0")
    assert (info.size, info.limits.bit_depths) == ((640, 480), (8, 12))
    camera.close()


def test_the_wrong_serial_number_is_told_with_those_that_answer(pyspin: FakePySpin) -> None:
    camera = SpinnakerCamera("left camera", GenicamConfiguration(serial="7"))
    with pytest.raises(DeviceNotFoundError, match=r"no camera with the serial number 7 .*23S6M 20497219, .*20497220"):
        camera.open()
    assert camera.state is CameraState.CLOSED
    with pytest.raises(DeviceNotFoundError, match="name one camera by its serial number"):
        SpinnakerCamera("left camera", GenicamConfiguration()).open()
    assert pyspin.released == 2


@pytest.mark.parametrize(
    ("code", "kind"), [(DENIED, DeviceBusyError), (IN_USE, DeviceBusyError), (IO, DeviceNotFoundError)]
)
def test_a_camera_that_cannot_be_opened(device: FakeDevice, code: int, kind: type[DriverError]) -> None:
    camera = camera_of(device)
    device.init_error = code
    with pytest.raises(kind, match=r"left camera: .*Could not open") as caught:
        camera.open()
    assert type(caught.value) is kind
    device.init_error = 0
    camera.open()
    camera.close()


def test_a_camera_is_opened_once_in_a_program(device: FakeDevice) -> None:
    """The library would share it, and whoever closes first would close it for both."""
    first, second = camera_of(device), camera_of(device)
    first.open()
    with pytest.raises(DeviceBusyError, match="20497219 is open already"):
        second.open()
    first.configure(SHORT)
    first.close()
    second.open()
    second.close()


def test_without_pyspin_the_way_to_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PySpin", None)
    camera = SpinnakerCamera("left camera", GenicamConfiguration())
    with pytest.raises(
        DeviceUnavailableError, match=r"^left camera: PySpin cannot be loaded .*Spinnaker SDK"
    ) as caught:
        camera.open()
    assert len(str(caught.value).splitlines()) == 1
    assert camera.state is CameraState.CLOSED
    with pytest.raises(DeviceUnavailableError):
        find_cameras()


def test_cameras_that_answer_are_listed(pyspin: FakePySpin) -> None:
    assert [(camera.serial, camera.protocol) for camera in find_cameras()] == [
        ("20497219", "USB3Vision"),
        ("20497220", "USB3Vision"),
    ]
    assert pyspin.released == 1


def test_the_configuration_chooses_the_driver(pyspin: FakePySpin) -> None:
    sides = {side: {"serial": device.serial} for side, device in zip(SIDES, pyspin.devices, strict=True)}
    configuration = CamerasConfiguration.model_validate({"driver": "spinnaker", **sides})
    cameras = [make_camera(side, configuration) for side in SIDES]
    assert [camera.open().serial for camera in cameras] == ["20497219", "20497220"]
    assert [camera.name for camera in cameras] == ["left camera", "right camera"]
    assert {camera.info.driver for camera in cameras} == {"spinnaker"}
    for camera in cameras:
        camera.close()
    with pytest.raises(DeviceConfigurationError, match=r"told apart.*there are: .*20497219, .*20497220"):
        hardware_rig(CamerasConfiguration(driver="spinnaker"), LightCrafterConfiguration())
    assert make_camera("left", CamerasConfiguration()).__class__ is AravisCamera
