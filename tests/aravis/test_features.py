"""What the camera holds after configuring: nothing that bends grey values, and all of it read back."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from drivers.aravis import AravisCamera
from drivers.camera import CameraSettings, CameraState, Trigger
from drivers.errors import DeviceConfigurationError, DeviceStateError
from drivers.genicam import GenicamConfiguration
from drivers.gigevision import SimulatedGrasshopper

SHORT = CameraSettings(exposure_us=2000)
Open = Callable[..., AravisCamera]


@pytest.fixture
def opened(grasshopper: SimulatedGrasshopper) -> Iterator[Open]:
    """Opens the simulated camera under a configuration; closes it in the end."""
    made: list[AravisCamera] = []

    def opened(**more: object) -> AravisCamera:
        configuration = GenicamConfiguration.model_validate({"address": grasshopper.address, **more})
        camera = AravisCamera("left camera", configuration)
        made.append(camera)
        camera.open()
        return camera

    yield opened
    for camera in made:
        camera.close()


def test_automatic_functions_that_run_from_the_factory_are_switched_off(
    opened: Open, grasshopper: SimulatedGrasshopper
) -> None:
    names = ("ExposureAuto", "GainAuto", "pgrExposureCompensationAuto", "GammaEnabled", "SharpnessEnabled")
    grasshopper.set_feature("pgrHDRModeEnabled", 1)
    assert all(grasshopper.feature(name) for name in names)
    applied = opened().configure(SHORT)
    for name in (*names, "pgrHDRModeEnabled"):
        assert grasshopper.feature(name) == 0
        assert applied.features[name] in ("Off", False)


@pytest.mark.parametrize(("name", "value"), [("GainAuto", 2), ("ExposureAuto", 1), ("GammaEnabled", 1)])
def test_arming_is_refused_when_one_is_on_again(
    opened: Open, grasshopper: SimulatedGrasshopper, name: str, value: int
) -> None:
    camera = opened()
    before = camera.configure(SHORT)
    grasshopper.set_feature(name, value)
    assert camera.read_settings() != before
    with pytest.raises(DeviceConfigurationError) as caught:
        camera.arm(1, Trigger.HARDWARE_EDGE)
    assert caught.value.feature == name
    assert camera.state is CameraState.CONFIGURED
    assert camera.configure(SHORT) == before
    camera.arm(1, Trigger.HARDWARE_EDGE)


@pytest.mark.parametrize("name", ["GammaEnabled", "GainAuto"])
def test_one_that_does_not_go_off_is_refused_unless_allowed(
    opened: Open, grasshopper: SimulatedGrasshopper, name: str
) -> None:
    grasshopper.stick(name)
    with pytest.raises(DeviceConfigurationError, match=f"{name} cannot be .*reads back as"):
        opened()
    if name == "GammaEnabled":
        camera = opened(processing=True)
        assert camera.configure(SHORT).features[name] is True


@pytest.mark.parametrize("name", ["TriggerSource", "TriggerActivation", "TriggerMode", "Width", "ExposureTime"])
def test_what_is_needed_and_does_not_read_back_is_refused(
    opened: Open, grasshopper: SimulatedGrasshopper, name: str
) -> None:
    grasshopper.stick(name)
    with pytest.raises(DeviceConfigurationError) as caught:
        opened().configure(SHORT)
    assert caught.value.feature == name


def test_the_trigger_stands_as_wired(opened: Open, grasshopper: SimulatedGrasshopper) -> None:
    camera = opened(trigger_line="Line2", trigger_activation="FallingEdge", trigger_overlap="Off")
    camera.configure(SHORT)
    camera.arm(1, Trigger.HARDWARE_EDGE)
    names = ("TriggerMode", "TriggerSource", "TriggerActivation", "TriggerOverlap", "TriggerDelayEnabled")
    assert [grasshopper.feature(name) for name in names] == [1, 3, 1, 0, 0]
    assert not grasshopper.pulse("Line3", "FallingEdge")
    assert not grasshopper.pulse("Line2", "RisingEdge")
    assert grasshopper.pulse("Line2", "FallingEdge")
    assert camera.wait_frame(3.0).frame_id == 0


@pytest.mark.parametrize(
    ("asked", "region"),
    [
        ({}, (640, 480, 640, 360)),
        ({"width": 650, "height": 481}, (640, 480, 640, 360)),
        ({"offset_x": 101, "offset_y": 7}, (640, 480, 100, 6)),
        ({"width": 4000, "height": 3000}, (1920, 1200, 0, 0)),
        ({"width": 1000, "offset_x": 1900}, (992, 480, 928, 360)),
    ],
    ids=str,
)
def test_the_region_snaps_to_the_camera(
    opened: Open, grasshopper: SimulatedGrasshopper, asked: dict[str, int], region: tuple[int, int, int, int]
) -> None:
    camera = opened(**asked)
    applied = camera.configure(SHORT)
    assert applied.size == camera.info.size == region[:2]
    assert tuple(grasshopper.feature(name) for name in ("Width", "Height", "OffsetX", "OffsetY")) == region


def test_a_region_left_by_another_program_does_not_stand_in_the_way(
    opened: Open, grasshopper: SimulatedGrasshopper
) -> None:
    for name, value in (("Width", 64), ("OffsetX", 1856), ("Height", 1200), ("TriggerMode", 1)):
        grasshopper.set_feature(name, value)
    assert opened().configure(SHORT).size == (640, 480)


def test_exposure_and_gain_snap_and_read_back(opened: Open) -> None:
    applied = opened().configure(CameraSettings(exposure_us=2000.2, gain_db=6.0049))
    assert applied.exposure_us == 2000.0
    assert applied.gain_db == pytest.approx(6.0)
    assert (applied.bit_depth, applied.white_level) == (8, 255)


def test_twelve_bits_have_sixteen_times_as_many_levels(opened: Open, grasshopper: SimulatedGrasshopper) -> None:
    camera = opened()
    highest = []
    for depth in (8, 12):
        camera.configure(CameraSettings.model_validate({"exposure_us": 2000, "bit_depth": depth}))
        camera.arm(1, Trigger.SOFTWARE)
        camera.software_trigger()
        highest.append(int(camera.wait_frame(3.0).image[100:].max()))
        camera.disarm()
    assert highest[1] == 16 * highest[0] > 0


def test_readout_and_exposure_decide_the_shortest_period(opened: Open) -> None:
    overlapping, apart = (
        opened(readout_us=3000.0),
        AravisCamera("right camera", GenicamConfiguration(readout_us=3000.0, trigger_overlap="Off")),
    )
    for exposure_us, with_overlap in ((8000.0, 8100.0), (1000.0, 3100.0)):
        settings = CameraSettings(exposure_us=exposure_us)
        assert overlapping.min_period_us(settings) == pytest.approx(with_overlap)
        assert apart.min_period_us(settings) == pytest.approx(exposure_us + 3100.0)


def test_a_software_trigger_waits_for_the_exposure_before(opened: Open) -> None:
    camera = opened()
    camera.configure(CameraSettings(exposure_us=30_000))
    camera.arm(3, Trigger.SOFTWARE)
    for _ in range(3):
        camera.software_trigger()
    assert [camera.wait_frame(3.0).frame_id for _ in range(3)] == [0, 1, 2]
    camera.disarm()
    with pytest.raises(DeviceStateError):
        camera.software_trigger()


def test_running_freely_keeps_the_rate_asked(opened: Open) -> None:
    camera = opened(live_rate_hz=50.0)
    camera.configure(SHORT)
    camera.arm(None, Trigger.FREE_RUN)
    frames = [camera.wait_frame(3.0) for _ in range(6)]
    assert 1e9 * 5 / (frames[-1].device_ns - frames[0].device_ns) < 60


def test_the_step_of_the_camera_clock_is_recorded(opened: Open) -> None:
    """A time cannot be finer than this, and how fine it is differs between cameras."""
    assert opened().configure(SHORT).features["TimestampIncrement"] == 1
