"""What is said of a computer before its devices are opened."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from made_up_host import CAMERA, PROJECTOR, RULE, MadeUpHost

from drivers.aravis.diagnosis import LibraryVersion, LoadedLibrary
from drivers.errors import DeviceUnavailableError
from drivers.registry import RigConfiguration
from service.diagnosis import host as module
from service.diagnosis.host import examine_host
from service.diagnosis.symptom import Symptom

RULES = (Path(__file__).parents[2] / "docker" / "99-duofringe.rules").read_text()
GOOD = LoadedLibrary(Path("/usr/lib/libaravis-0.8.so.0"), LibraryVersion(0, 8, 34))


@pytest.fixture(autouse=True)
def library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "loaded_library", lambda path: GOOD)


@pytest.fixture
def made_up(tmp_path: Path) -> MadeUpHost:
    """As it should be."""
    made = MadeUpHost(tmp_path)
    made.attach(CAMERA, "0138C343")
    made.attach(CAMERA, "0138C344")
    made.attach(PROJECTOR, speed="12")
    made.add_rules(RULES)
    made.allow_memory(1000)
    return made


def looked_at(made_up: MadeUpHost, **rig: Any) -> dict[str, Symptom]:
    configuration = RigConfiguration.model_validate({"driver": "hardware", **rig})
    symptoms = list(examine_host(configuration, made_up.root))
    assert all(bool(symptom.remedy) == (symptom.state != "ok") for symptom in symptoms)
    assert all("\n" not in symptom.remedy + symptom.finding for symptom in symptoms)
    return {symptom.subject: symptom for symptom in symptoms}


def test_all_is_well(made_up: MadeUpHost) -> None:
    told = looked_at(made_up)
    assert {symptom.state for symptom in told.values()} == {"ok"}
    assert set(told) == {
        "camera library",
        "cameras on USB",
        "udev rule for cameras",
        "access to cameras",
        "usbfs memory",
        "link of camera 0138C343",
        "link of camera 0138C344",
        "udev rule for projector",
        "access to projector",
    }
    assert "0.8.34" in told["camera library"].finding


@pytest.mark.parametrize("driver", ["simulated", "replay"])
def test_rigs_that_are_no_hardware_need_nothing(made_up: MadeUpHost, driver: str) -> None:
    assert looked_at(made_up, driver=driver) == {}


def test_auto_is_hardware_once_it_is_there(made_up: MadeUpHost, tmp_path: Path) -> None:
    assert looked_at(made_up, driver="auto").keys() == looked_at(made_up).keys()
    assert looked_at(MadeUpHost(tmp_path / "bare"), driver="auto") == {}


def test_a_bench_needs_the_library_alone(made_up: MadeUpHost) -> None:
    assert set(looked_at(made_up, driver="bench")) == {"camera library"}


def test_cameras_on_the_network_need_no_usb(made_up: MadeUpHost) -> None:
    cameras = {"left": {"address": "10.0.0.2"}, "right": {"address": "10.0.0.3"}}
    told = looked_at(made_up, cameras=cameras)
    assert set(told) == {"camera library", "udev rule for projector", "access to projector"}


@pytest.mark.parametrize(
    ("version", "state"), [(LibraryVersion(0, 8, 30), "warning"), (LibraryVersion(0, 8, 31), "ok"), (None, "warning")]
)
def test_an_old_library_is_warned_of(
    made_up: MadeUpHost, monkeypatch: pytest.MonkeyPatch, version: LibraryVersion | None, state: str
) -> None:
    monkeypatch.setattr(module, "loaded_library", lambda path: LoadedLibrary(None, version))
    symptom = looked_at(made_up)["camera library"]
    assert symptom.state == state
    assert ("rig.cameras.left.library" in symptom.remedy) == (state == "warning")


def test_an_old_library_serves_cameras_on_the_network(made_up: MadeUpHost, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "loaded_library", lambda path: LoadedLibrary(None, LibraryVersion(0, 8, 26)))
    cameras = {"left": {"address": "10.0.0.2"}, "right": {"address": "10.0.0.3"}}
    assert looked_at(made_up, cameras=cameras)["camera library"].state == "ok"


def test_a_library_that_is_not_there(made_up: MadeUpHost, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(path: str | None) -> LoadedLibrary:
        raise DeviceUnavailableError("camera", f"the library {path} cannot be loaded")

    monkeypatch.setattr(module, "loaded_library", missing)
    symptom = looked_at(made_up, cameras={"left": {"library": "/a.so"}, "right": {"library": "/a.so"}})[
        "camera library"
    ]
    assert (symptom.state, "/a.so" in symptom.finding) == ("fault", True)
    assert "libaravis-0.8-0" in symptom.remedy


def test_without_rules_the_file_is_to_be_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made_up = MadeUpHost(tmp_path)
    made_up.attach(CAMERA)
    made_up.attach(PROJECTOR)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    told = looked_at(made_up)
    for what in ("cameras", "projector"):
        symptom = told[f"udev rule for {what}"]
        assert symptom.state == "warning"
        assert "docker/99-duofringe.rules" in symptom.remedy
        assert "only root" in symptom.finding


def test_access_without_a_rule_is_access(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container, whose host has the rules."""
    made_up = MadeUpHost(tmp_path)
    made_up.attach(CAMERA)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    told = looked_at(made_up)
    assert (told["udev rule for cameras"].state, told["access to cameras"].state) == ("ok", "ok")
    assert told["udev rule for projector"].state == "warning"


def test_a_node_that_may_not_be_written_to(made_up: MadeUpHost, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    told = looked_at(made_up)
    assert told["access to cameras"].state == told["access to projector"].state == "fault"
    assert "plugdev" in told["access to projector"].remedy


def test_a_node_that_is_not_in_the_container(made_up: MadeUpHost) -> None:
    node = made_up.attach(CAMERA, node=False)
    symptom = looked_at(made_up)["access to cameras"]
    assert (symptom.state, str(node) in symptom.finding) == ("fault", True)
    assert "/dev/bus/usb" in symptom.remedy


@pytest.mark.parametrize(("megabytes", "state"), [(16, "warning"), (999, "warning"), (1000, "ok"), (0, "ok")])
def test_memory_for_transfers(made_up: MadeUpHost, megabytes: int, state: str) -> None:
    made_up.allow_memory(megabytes)
    symptom = looked_at(made_up)["usbfs memory"]
    assert symptom.state == state
    if state == "warning":
        assert "usbfs_memory_mb" in symptom.remedy
        assert "tmpfiles.d" in symptom.remedy


@pytest.mark.parametrize(("speed", "state"), [("480", "fault"), ("5000", "ok"), ("10000", "ok"), ("?", "warning")])
def test_the_link_of_a_camera(made_up: MadeUpHost, speed: str, state: str) -> None:
    made_up.attach(CAMERA, "slow", speed)
    assert looked_at(made_up)["link of camera slow"].state == state


def test_a_missing_camera_is_counted(tmp_path: Path) -> None:
    made_up = MadeUpHost(tmp_path)
    made_up.attach(CAMERA, "0138C343")
    made_up.add_rules(RULE)
    symptom = looked_at(made_up)["cameras on USB"]
    assert (symptom.state, symptom.finding) == ("warning", "1 of vendor 1e10 (0138C343)")


def test_the_port_of_a_bridge(made_up: MadeUpHost, monkeypatch: pytest.MonkeyPatch) -> None:
    projector = {"connection": "usb-iss", "port": "/dev/ttyACM0"}
    told = looked_at(made_up, projector=projector)
    assert told["bridge to the projector"].state == "fault"
    assert "access to projector" not in told
    made_up.write("dev/ttyACM0", "")
    assert looked_at(made_up, projector=projector)["bridge to the projector"].state == "ok"
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert "dialout" in looked_at(made_up, projector=projector)["bridge to the projector"].remedy
