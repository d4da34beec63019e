"""``duofringe doctor`` as a whole, before emulated hardware and made-up hosts."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from emulated_rig import EmulatedRig
from made_up_host import CAMERA, MadeUpHost

from drivers.camera import CameraState
from drivers.lightcrafter.values import Release
from drivers.projector import ProjectorState
from service.diagnosis import Symptom, examine
from service.diagnosis import rig as rig_module
from service.settings import load_settings

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def in_its_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def attached(emulated: EmulatedRig, monkeypatch: pytest.MonkeyPatch) -> EmulatedRig:
    """What the driver "bench" makes is the emulated rig."""
    monkeypatch.setattr(rig_module, "make_devices", lambda _: emulated.devices)
    return emulated


def told_of(root: Path, *, exposure: bool = True) -> dict[str, Symptom]:
    settings = load_settings(given={"rig": {"driver": "bench"}})
    return {symptom.subject: symptom for symptom in examine(settings, exposure=exposure, root=root)}


def is_put_away(rig: EmulatedRig) -> bool:
    cameras = {camera.state for camera in rig.devices.cameras.values()}
    return cameras == {CameraState.CLOSED} and rig.projector.state is ProjectorState.CLOSED


def test_good_wires_are_told_before_the_capture(attached: EmulatedRig, tmp_path: Path) -> None:
    """On a machine that is busy with other tests, frames of the network may be lost: it has three tries."""
    for _ in range(3):
        told = told_of(tmp_path)
        if all(symptom.state == "ok" for subject, symptom in told.items() if subject.startswith("trigger wiring")):
            break
    for side in ("left", "right"):
        assert told[f"trigger wiring of {side} camera"].finding == "8 of 8 pulses"
        assert told[f"link of {side} camera"].state == "ok"
    subjects = list(told)
    assert subjects.index("camera library") < subjects.index("left camera") < subjects.index("projector LEDs")
    assert subjects.index("trigger wiring of right camera") < subjects.index("test exposure")
    assert is_put_away(attached)


def test_a_rig_without_wires_is_not_asked_for_them(
    attached: EmulatedRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DUOFRINGE_ACQUISITION__TRIGGER", "software")
    told = told_of(tmp_path)
    assert not [subject for subject in told if subject.startswith("trigger wiring")]
    assert "test exposure" in told
    assert is_put_away(attached)


def test_a_wire_that_is_pulled_is_told_and_no_capture_tried(attached: EmulatedRig, tmp_path: Path) -> None:
    attached.wires = {"left"}
    told = told_of(tmp_path)
    assert "trigger wiring of left camera" in told
    assert told["trigger wiring of right camera"].finding == "none of 8 pulses"
    assert "rig.cameras.right.trigger_line" in told["trigger wiring of right camera"].remedy
    assert "test exposure" not in told
    assert is_put_away(attached)


def test_no_wire_at_all(attached: EmulatedRig, tmp_path: Path) -> None:
    attached.wires = set()
    assert told_of(tmp_path)["trigger wiring"].state == "fault"


def test_without_exposure_no_pulse_is_sent(attached: EmulatedRig, tmp_path: Path) -> None:
    told = told_of(tmp_path, exposure=False)
    assert attached.controller.pulses_sent == 0
    assert not any(subject.startswith(("trigger wiring", "test exposure")) for subject in told)
    assert "projector LEDs" in told
    assert is_put_away(attached)


def test_the_option_asks_for_no_light(run: Run, attached: EmulatedRig) -> None:
    status, out, _ = run("doctor", "--driver", "bench", "--skip-exposure", "--json")
    assert (status, json.loads(out)["ok"]) == (0, True)
    assert attached.controller.pulses_sent == 0


def test_a_fault_of_the_wires_is_an_exit_status(run: Run, attached: EmulatedRig) -> None:
    attached.wires = {"right"}
    status, out, _ = run("doctor", "--driver", "bench")
    assert status == 1
    assert "FAULT    trigger wiring of left camera: none of 8 pulses" in out
    assert "mend: check its trigger cable" in out


def test_old_firmware_is_a_fault_that_tells_what_to_do(
    aravis: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with EmulatedRig(controller={"version": Release(2, 0, 0)}) as rig:
        monkeypatch.setattr(rig_module, "make_devices", lambda _: rig.devices)
        symptom = told_of(tmp_path)["projector"]
    assert symptom.state == "fault"
    assert "3.0.0 is the oldest that works; update it" in symptom.finding


def test_access_is_told_even_where_no_device_can_be_opened(aravis: None, tmp_path: Path) -> None:
    """Cameras that may not be opened are not listed, so the rig only says that it found none."""
    made_up = MadeUpHost(tmp_path / "host")
    node = made_up.attach(CAMERA, "0138C343", node=False)
    settings = load_settings(given={"rig": {"driver": "hardware"}})
    told = {symptom.subject: symptom for symptom in examine(settings, root=made_up.root)}
    assert str(node) in told["access to cameras"].finding
    assert told["rig"].state == "fault"
