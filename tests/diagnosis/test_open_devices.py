"""What the drivers tell of library, cameras and projector beyond their protocols."""

from __future__ import annotations

from typing import Any

import pytest
from emulated_rig import MANIFEST, EmulatedRig

from drivers.aravis.diagnosis import LibraryVersion, loaded_library
from drivers.errors import DeviceLostError, DeviceStateError, DeviceUnavailableError
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.link import CameraLink, examine_camera, link_of
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.diagnosis import examine_projector, supply_a
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.values import Currents, HardwareStatus, Release
from drivers.projector import ProjectorSettings
from models.patterns import make_plan
from service.diagnosis.hardware import examine_hardware
from service.diagnosis.symptom import Symptom


class ToldFeatures:
    """Features with set values."""

    def __init__(self, **values: str | int) -> None:
        self._values = values

    def has(self, name: str) -> bool:
        return name in self._values

    def read(self, name: str, kind: Any) -> Any:
        return kind(self._values[name])


def told_of(rig: EmulatedRig) -> dict[str, Symptom]:
    return {symptom.subject: symptom for symptom in examine_hardware(rig.devices)}


def test_the_library_tells_its_release_and_place(aravis: None) -> None:
    library = loaded_library()
    assert library.version is not None
    assert LibraryVersion(0, 8, 26) <= library.version < LibraryVersion(0, 9, 0)
    assert library.path is not None
    assert library.path.is_file()
    assert loaded_library(str(library.path)) == library


def test_a_library_that_is_not_there_is_named() -> None:
    with pytest.raises(DeviceUnavailableError, match=r"/no/where/libaravis\.so"):
        loaded_library("/no/where/libaravis.so")


@pytest.mark.parametrize(
    ("protocol", "features", "bits_per_s", "slow"),
    [
        ("USB3Vision", {"U3VCurrentSpeed": "SuperSpeed"}, 5e9, False),
        ("USB3Vision", {"U3VCurrentSpeed": "SuperSpeedPlus"}, 10e9, False),
        ("USB3Vision", {"U3VCurrentSpeed": "HighSpeed"}, 480e6, True),
        ("USB3Vision", {"U3VCurrentSpeed": "Unheard"}, None, False),
        ("USB3Vision", {"DeviceLinkSpeed": 500_000_000}, 4e9, False),
        ("USB3Vision", {"DeviceLinkSpeed": 60_000_000}, 480e6, True),
        ("GigEVision", {"DeviceLinkSpeed": 125_000_000}, 1e9, False),
        ("GigEVision", {"DeviceLinkSpeed": 12_500_000}, 100e6, True),
        ("GigEVision", {}, None, False),
    ],
)
def test_speeds(protocol: str, features: dict[str, str | int], bits_per_s: float | None, slow: bool) -> None:
    link = link_of(ToldFeatures(**features), protocol)
    assert (link.bits_per_s, link.slow, link.transmit_failures) == (bits_per_s, slow, None)


def test_the_link_of_an_open_camera(emulated: EmulatedRig) -> None:
    camera = emulated.devices.left
    assert isinstance(camera, GenicamCamera)
    with pytest.raises(DeviceStateError, match="closed"):
        examine_camera(camera)
    camera.open()
    assert examine_camera(camera) == CameraLink("GigEVision", None, 0)


def test_frames_that_a_camera_could_not_send_are_warned_of(emulated: EmulatedRig) -> None:
    emulated.open()
    emulated.cameras["right"].set_feature("TransmitFailureCount", 3)
    told = told_of(emulated)
    assert told["link of left camera"].state == "ok"
    assert told["link of right camera"].state == "warning"
    assert "3 frames" in told["link of right camera"].finding


def test_a_good_projector(emulated: EmulatedRig) -> None:
    report = examine_projector(emulated.open().projector)  # type: ignore[arg-type]
    assert report.firmware == Release(4, 4, 0)
    assert report.drive == report.limits == (151, 120, 125)
    assert report.faults == ""
    assert report.flash_images == report.needed_images == MANIFEST.images
    assert report.supply_a == pytest.approx(3.643, abs=0.001)
    told = told_of(emulated)
    assert {symptom.state for symptom in told.values()} == {"ok"}
    assert "3.6 A" in told["projector LEDs"].finding


def test_less_brightness_is_read_back(emulated: EmulatedRig) -> None:
    projector = emulated.open().projector
    projector.configure(ProjectorSettings(brightness=0.5))
    assert examine_projector(emulated.projector).drive == (76, 60, 62)


def test_a_closed_projector_is_not_asked(emulated: EmulatedRig) -> None:
    with pytest.raises(DeviceStateError, match="closed"):
        examine_projector(emulated.projector)


def test_current_without_light() -> None:
    assert supply_a((0, 0, 0)) < 1
    assert supply_a((255, 255, 255)) > 6


def test_leds_beyond_the_limit_are_a_fault(emulated: EmulatedRig) -> None:
    """Another program has written to the controller since."""
    emulated.open()
    emulated.controller.handle(c.LED_CURRENT.usb, c.LED_CURRENT.encode(Currents(0, 255, 130)))
    symptom = told_of(emulated)["projector LEDs"]
    assert symptom.state == "fault"
    assert "red beyond the limit" in symptom.finding


def test_limits_beyond_the_supply_are_warned_of(aravis: None) -> None:
    with EmulatedRig(led_limits=(255, 255, 255)) as rig:
        rig.open()
        symptom = told_of(rig)["projector LEDs"]
    assert symptom.state == "warning"
    assert "rig.projector.led_limits" in symptom.remedy


def test_errors_of_the_controller_are_told_in_words(emulated: EmulatedRig) -> None:
    emulated.open()
    emulated.controller.faults.hardware = int(HardwareStatus.SEQUENCE_ABORTED)
    symptom = told_of(emulated)["projector status"]
    assert (symptom.state, symptom.finding) == ("warning", "the sequencer aborted")


def test_a_projector_that_falls_silent_is_a_fault(emulated: EmulatedRig) -> None:
    emulated.open()
    emulated.controller.unplug()
    with pytest.raises(DeviceLostError):
        examine_projector(emulated.projector)
    assert told_of(emulated)["projector status"].state == "fault"


def test_flash_that_holds_more_than_the_manifest_does_no_harm(aravis: None) -> None:
    with EmulatedRig(FlashManifest.packed(make_plan("composite"))) as rig:
        rig.open()
        symptom = told_of(rig)["projector flash"]
    assert (symptom.state, symptom.finding) == ("ok", f"{MANIFEST.images} images, the manifest needs 1")


def test_flash_that_has_lost_images_is_a_fault(emulated: EmulatedRig) -> None:
    emulated.open()
    emulated.controller.flash = EmulatedFlash([MANIFEST.render(0)])
    assert told_of(emulated)["projector flash"].state == "fault"
