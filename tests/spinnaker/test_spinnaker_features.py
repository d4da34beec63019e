"""What the camera holds after configuring through Spinnaker's node maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from fake_pyspin import FakeDevice

from drivers.camera import CameraSettings, Trigger
from drivers.errors import DeviceConfigurationError
from drivers.genicam import GenicamConfiguration
from drivers.spinnaker import SpinnakerCamera

SHORT = CameraSettings(exposure_us=2000)
Open = Callable[..., SpinnakerCamera]


@pytest.fixture
def opened(device: FakeDevice) -> Iterator[Open]:
    """Opens the camera under a configuration; closes it in the end."""
    made: list[SpinnakerCamera] = []

    def opened(**more: object) -> SpinnakerCamera:
        configuration = GenicamConfiguration.model_validate({"serial": device.serial, **more})
        made.append(SpinnakerCamera("left camera", configuration))
        made[-1].open()
        return made[-1]

    yield opened
    for camera in made:
        camera.close()


def test_whatever_bends_grey_values_is_switched_off(opened: Open, device: FakeDevice) -> None:
    names = ("ExposureAuto", "GainAuto", "pgrExposureCompensationAuto", "GammaEnabled", "SharpnessEnabled")
    assert all(device.nodes.values[name] for name in names)
    applied = opened().configure(SHORT)
    assert not any(device.nodes.values[name] for name in names)
    assert [applied.features[name] for name in names] == ["Off", "Off", "Off", False, False]


@pytest.mark.parametrize("name", ["GammaEnabled", "GainAuto", "TriggerSource", "Width", "ExposureTime"])
def test_what_does_not_read_back_from_the_camera_is_refused(opened: Open, device: FakeDevice, name: str) -> None:
    """Though the library's cache holds what was written."""
    device.nodes.stuck.add(name)
    with pytest.raises(DeviceConfigurationError, match=f"{name} cannot be .*reads back as") as caught:
        opened().configure(SHORT)
    assert caught.value.feature == name


def test_gamma_is_left_alone_where_that_is_asked(opened: Open, device: FakeDevice) -> None:
    device.nodes.stuck.add("GammaEnabled")
    applied = opened(processing=True)
    device.nodes.values |= {"ExposureAuto": 0, "GainAuto": 0}
    assert applied.configure(SHORT).features["GammaEnabled"] is True


def test_arming_is_refused_when_an_automatic_function_is_on_again(opened: Open, device: FakeDevice) -> None:
    camera = opened()
    camera.configure(SHORT)
    device.nodes.choose("GainAuto", "Continuous")
    with pytest.raises(DeviceConfigurationError, match="GainAuto cannot be Off; the camera has switched it"):
        camera.arm(1, Trigger.HARDWARE_EDGE)
    assert not device.acquiring


def test_a_feature_that_is_locked_is_named(opened: Open, device: FakeDevice) -> None:
    camera = opened()
    device.nodes.values["TLParamsLocked"] = 1
    device.nodes.values["Width"] = 320
    with pytest.raises(DeviceConfigurationError, match="Width cannot be 640; the camera says: it is locked now"):
        camera.configure(SHORT)
    device.nodes.values["TLParamsLocked"] = 0


def test_the_trigger_stands_as_wired(opened: Open, device: FakeDevice) -> None:
    camera = opened(trigger_line="Line0", trigger_activation="FallingEdge", trigger_overlap="Off")
    camera.configure(SHORT)
    camera.arm(1, Trigger.HARDWARE_EDGE)
    chosen = {name: device.nodes.entry(name) for name in ("TriggerSource", "TriggerActivation", "TriggerOverlap")}
    assert chosen == {"TriggerSource": "Line0", "TriggerActivation": "FallingEdge", "TriggerOverlap": "Off"}
    device.pulse("Line0", "RisingEdge")
    device.pulse("Line3", "FallingEdge")
    device.pulse("Line0", "FallingEdge")
    assert camera.wait_frame(1.0).frame_id == 0
    assert camera.disarm().unclaimed == 0


def test_the_region_snaps_to_the_camera(opened: Open, device: FakeDevice) -> None:
    device.nodes.values |= {"OffsetX": 1856, "Width": 64, "TriggerMode": 1}
    camera = opened(width=650, height=481, offset_x=101)
    assert camera.configure(SHORT).size == (640, 480)
    assert [device.nodes.values[name] for name in ("OffsetX", "OffsetY")] == [100, 360]


def test_twelve_bits_lie_in_the_lower_part(opened: Open) -> None:
    camera = opened()
    highest = []
    for depth in (8, 12):
        camera.configure(CameraSettings.model_validate({"exposure_us": 2000, "bit_depth": depth}))
        camera.arm(1, Trigger.SOFTWARE)
        camera.software_trigger()
        highest.append(int(camera.wait_frame(3.0).image[100:].max()))
        camera.disarm()
    assert highest[1] == 16 * highest[0] > 0


def test_device_times_are_nanoseconds(opened: Open) -> None:
    camera = opened(live_rate_hz=50.0)
    camera.configure(SHORT)
    camera.arm(None, Trigger.FREE_RUN)
    first, second = (camera.wait_frame(1.0) for _ in range(2))
    assert second.device_ns - first.device_ns == pytest.approx(20e6, rel=0.01)
