"""Counting the pulses that cameras see, over virtual devices with faults."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_rig import RecordedRig, recorded_rig

from drivers.camera import CameraState, Trigger
from drivers.errors import DeviceLostError, DriverError, ProtocolError
from drivers.virtual.faults import PlantedFault
from models.geometry.rig import SIDES
from service.acquisition.cancellation import Cancellation, CaptureCancelledError
from service.acquisition.wiring import LineCount, WiringCount, count_pulses

PULSES = 6


@pytest.fixture
def rig(full_capture: Path) -> RecordedRig:
    return recorded_rig(full_capture)


def count(rig: RecordedRig, *faults: PlantedFault) -> WiringCount:
    for fault in faults:
        rig.bench.faults.plant(fault)
    counted = count_pulses(rig.devices, rig.orchestrator.settings, pulses=PULSES)
    assert rig.is_safe
    return counted


def test_good_wires(rig: RecordedRig) -> None:
    counted = count(rig)
    assert counted.sent == PULSES
    assert counted.lines == {side: LineCount(f"{side} camera", 0, PULSES) for side in SIDES}
    assert not counted.silent
    assert counted.failure == ""


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (PlantedFault("ignored", "left", 2), LineCount("left camera", 0, PULSES - 1)),
        (PlantedFault("doubled", "left", 2), LineCount("left camera", 0, PULSES + 1)),
        (PlantedFault("dropped", "left", 2), LineCount("left camera", 0, PULSES, 1)),
        (PlantedFault("truncated", "left", 2), LineCount("left camera", 0, PULSES, 1)),
        (PlantedFault("early", "left"), LineCount("left camera", 1, PULSES)),
    ],
    ids=lambda value: value.kind if isinstance(value, PlantedFault) else "",
)
def test_what_one_camera_sees_otherwise(rig: RecordedRig, fault: PlantedFault, expected: LineCount) -> None:
    counted = count(rig, fault)
    assert counted.lines["left"] == expected
    assert counted.lines["right"] == LineCount("right camera", 0, PULSES)


def test_a_projector_that_sends_nothing(rig: RecordedRig) -> None:
    counted = count(rig, PlantedFault("not_started"))
    assert counted.silent
    assert [line.seen for line in counted.lines.values()] == [0, 0]


def test_a_camera_that_dies_at_a_pulse_is_told(rig: RecordedRig) -> None:
    counted = count(rig, PlantedFault("dead_camera", "right", 3))
    assert counted.lines["right"].seen == 3
    assert "right camera" in counted.lines["right"].failure
    assert counted.lines["left"] == LineCount("left camera", 0, PULSES)


def test_the_settings_in_force_afterwards_are_usable(rig: RecordedRig) -> None:
    count(rig)
    assert {camera.state for camera in rig.devices.cameras.values()} == {CameraState.CONFIGURED}
    for camera in rig.devices.cameras.values():
        camera.arm(1, Trigger.HARDWARE_EDGE)
        camera.disarm()


@pytest.mark.parametrize("kind", ["start_refused", "unplugged"])
def test_a_projector_that_cannot_start_leaves_the_rig_safe(rig: RecordedRig, kind: str) -> None:
    rig.bench.faults.plant(PlantedFault(kind))  # type: ignore[arg-type]
    with pytest.raises((ProtocolError, DeviceLostError), match="projector"):
        count_pulses(rig.devices, rig.orchestrator.settings)
    assert rig.is_safe


def test_a_camera_lost_in_the_dark_leaves_the_rig_safe(rig: RecordedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(timeout_s: float) -> None:
        raise DeviceLostError("left camera", "does not answer any more")

    monkeypatch.setattr(rig.devices.left, "wait_frame", lost)
    with pytest.raises(DriverError, match="left camera"):
        count_pulses(rig.devices, rig.orchestrator.settings)
    assert rig.is_safe


def test_it_can_be_cancelled(rig: RecordedRig) -> None:
    cancellation = Cancellation()
    cancellation.request()
    with pytest.raises(CaptureCancelledError):
        count_pulses(rig.devices, rig.orchestrator.settings, cancellation=cancellation)
    assert rig.is_safe
