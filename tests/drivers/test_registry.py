"""Which devices a configuration makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from recorded import write

from drivers import registry
from drivers.aravis import AravisCamera
from drivers.devices import RigDevices
from drivers.errors import DeviceBusyError, DeviceConfigurationError, DeviceNotFoundError, DeviceUnavailableError
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.registry import RigConfiguration, make_devices
from drivers.replay.source import ReplaySource
from drivers.simulator.devices import SimulatedSource
from drivers.virtual.rig import bench_of, virtual_rig
from models.errors import CalibrationError
from models.geometry.rig import Rig
from models.patterns import make_plan


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings"
    folder.mkdir()
    write(folder, "a")
    write(folder, "half", sides=("left",))
    return folder


@pytest.fixture(autouse=True)
def no_hardware(monkeypatch: pytest.MonkeyPatch) -> dict[str, registry.Factory]:
    """An empty table, whatever is attached to this machine."""
    table: dict[str, registry.Factory] = {}
    monkeypatch.setattr(registry, "HARDWARE", table)
    return table


def test_the_simulated_rig_stands_before_the_scene_named() -> None:
    devices = make_devices(
        RigConfiguration.model_validate({"driver": "simulated", "simulated": {"seed": 5, "scene": 7}})
    )
    assert isinstance(devices.stage, SimulatedSource)
    assert devices.stage.provenance == {"seed": 5, "scene": 7}
    assert devices.left.open().origin == "simulated"
    assert devices.calibration is None
    assert devices.calibration_in_force == devices.stage.calibration
    assert devices.warnings == ()
    assert bench_of(devices).time.realtime


def test_a_replay_tells_what_was_left_out(recordings: Path) -> None:
    devices = make_devices(RigConfiguration(driver="replay", replay=recordings, realtime=False))
    assert isinstance(devices.stage, ReplaySource)
    assert devices.stage.scenes == ("a",)
    assert len(devices.warnings) == 1
    assert "half" in devices.warnings[0]
    assert not bench_of(devices).time.realtime


@pytest.mark.parametrize("driver", ["simulated", "replay"])
def test_a_calibration_file_goes_before_what_the_devices_know(
    tmp_path: Path, recordings: Path, rig: Rig, driver: Any
) -> None:
    rig.to_file(tmp_path / "calibration.json")
    configuration = RigConfiguration(driver=driver, replay=recordings, calibration=tmp_path / "calibration.json")
    assert make_devices(configuration).calibration_in_force == rig
    with pytest.raises(CalibrationError, match=r"absent\.json"):
        make_devices(configuration.model_copy(update={"calibration": tmp_path / "absent.json"}))


def test_a_replay_needs_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFoundError, match="folder"):
        make_devices(RigConfiguration(driver="replay"))
    with pytest.raises(DeviceNotFoundError, match="absent"):
        make_devices(RigConfiguration(driver="replay", replay=tmp_path / "absent"))


def test_without_hardware_a_named_folder_is_replayed_and_said_so(recordings: Path) -> None:
    devices = make_devices(RigConfiguration(replay=recordings))
    assert devices.left.open().origin == "replayed"
    first, second = devices.warnings
    assert first.startswith("no hardware was found (")
    assert first.endswith(f"replaying recorded captures from {recordings}")
    assert "half" in second


def test_without_hardware_and_folder_it_says_what_to_do() -> None:
    with pytest.raises(DeviceNotFoundError, match="no hardware was found") as caught:
        make_devices(RigConfiguration())
    assert len(str(caught.value).splitlines()) == 1
    assert "simulated" in str(caught.value)


def test_hardware_goes_before_a_replay(recordings: Path, no_hardware: dict[str, registry.Factory]) -> None:
    found = virtual_rig(ReplaySource(recordings))

    def absent(_: RigConfiguration) -> RigDevices:
        raise DeviceNotFoundError("left camera", "nothing answers")

    no_hardware |= {"absent": absent, "present": lambda _: found}
    assert make_devices(RigConfiguration(replay=recordings)) is found


@pytest.mark.parametrize("kind", [DeviceNotFoundError, DeviceUnavailableError])
def test_why_each_kind_of_hardware_is_not_there_is_told(
    recordings: Path, no_hardware: dict[str, registry.Factory], kind: type[DeviceNotFoundError]
) -> None:
    def absent(_: RigConfiguration) -> RigDevices:
        raise kind("left camera", "serial 42 does not answer")

    no_hardware["aravis"] = absent
    reason = "aravis: left camera: serial 42 does not answer"
    assert reason in make_devices(RigConfiguration(replay=recordings)).warnings[0]
    with pytest.raises(DeviceNotFoundError, match=reason):
        make_devices(RigConfiguration())


def test_hardware_that_another_program_holds_is_not_replaced_by_a_replay(
    recordings: Path, no_hardware: dict[str, registry.Factory]
) -> None:
    def busy(_: RigConfiguration) -> RigDevices:
        raise DeviceBusyError("left camera", "another program holds it")

    no_hardware["aravis"] = busy
    with pytest.raises(DeviceBusyError):
        make_devices(RigConfiguration(replay=recordings))


def test_cameras_that_are_not_told_apart_are_not_replaced_by_a_replay(
    recordings: Path, no_hardware: dict[str, registry.Factory], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are attached: the configuration is what lacks."""
    monkeypatch.setattr(registry, "require_attached", lambda cameras, projector: None)
    no_hardware["cameras"] = registry._attached
    with pytest.raises(DeviceConfigurationError, match=r"rig\.cameras\.left\.serial"):
        make_devices(RigConfiguration(replay=recordings))


def test_hardware_that_is_configured_is_made(tmp_path: Path) -> None:
    manifest = tmp_path / "manifest.json"
    FlashManifest.packed(make_plan("composite")).write(manifest)
    devices = make_devices(
        RigConfiguration.model_validate(
            {
                "driver": "hardware",
                "cameras": {"left": {"serial": "1"}, "right": {"address": "127.0.0.9"}},
                "projector": {"manifest": manifest},
            }
        )
    )
    assert [camera.name for camera in devices.cameras.values()] == ["left camera", "right camera"]
    assert isinstance(devices.left, AravisCamera)
    assert isinstance(devices.projector, LightCrafter)
    assert devices.stage is None


@pytest.mark.parametrize(
    "wrong",
    [{"driver": "imaginary"}, {"speed": 3}, {"simulated": {"seed": -1}}, {"simulated": {"scene": 1_000_000}}],
)
def test_a_configuration_that_makes_no_sense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        RigConfiguration.model_validate(wrong)
