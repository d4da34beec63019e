"""A plan without a trigger line: each pattern held, each frame called for."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.camera import CameraSettings, CameraState, Trigger
from drivers.errors import DriverError
from drivers.projector import ProjectorState
from drivers.replay.source import ReplaySource
from drivers.virtual.bench import Bench
from drivers.virtual.rig import bench_of, virtual_rig
from models.capture import read_capture
from service.acquisition.cancellation import CaptureCancelledError
from service.acquisition.finding import Fault
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest
from service.acquisition.settings import AcquisitionSettings


class Rig:
    """Before a recorded capture, with a trigger line that nobody listens to."""

    def __init__(self, folder: Path, retakes: int = 1) -> None:
        self.devices = virtual_rig(ReplaySource(folder), realtime=False)
        self.orchestrator = Orchestrator(self.devices, AcquisitionSettings(trigger="software", retakes=retakes))
        self.orchestrator.connect()

    @property
    def bench(self) -> Bench:
        return bench_of(self.devices)

    @property
    def is_safe(self) -> bool:
        armed = any(camera.state is CameraState.ARMED for camera in self.devices.cameras.values())
        return not armed and self.devices.projector.state is ProjectorState.OPEN and self.orchestrator.holder is None


@pytest.fixture
def stepped(full_capture: Path) -> Rig:
    return Rig(full_capture)


def test_frames_are_those_of_their_patterns(stepped: Rig, full_capture: Path) -> None:
    outcome = stepped.orchestrator.capture(CaptureRequest(plan="full"))
    recorded = read_capture(full_capture / "plate")
    for side in recorded.sides:
        for name in recorded.plan.names:
            np.testing.assert_array_equal(outcome.capture.images[side][name], recorded.images[side][name])
    assert stepped.bench.pulses_sent == 0
    assert outcome.capture.record.settings["trigger"] == str(Trigger.SOFTWARE)
    calls_us = outcome.capture.record.settings["projector"]["pulses_us"]
    assert calls_us[0] == 0
    assert all(np.diff(calls_us) > 0)
    assert stepped.is_safe


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_camera_that_goes_away_is_named(stepped: Rig, side: str, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = getattr(stepped.devices, side)
    call, calls = camera.software_trigger, []

    def trigger() -> None:
        calls.append(side)
        if len(calls) == 4:
            camera.unplug()
        call()

    monkeypatch.setattr(camera, "software_trigger", trigger)
    with pytest.raises(SequenceRefusedError) as caught:
        stepped.orchestrator.capture(CaptureRequest(plan="full"))
    assert any(f.fault is Fault.LOST and f.device == camera.name for f in caught.value.findings)
    assert stepped.orchestrator.holder is None


def test_a_camera_that_does_not_take_the_call_is_named(full_capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(full_capture, retakes=0)
    monkeypatch.setattr("service.acquisition.stepped._FRAME_S", 0.05)
    monkeypatch.setattr(rig.devices.right, "software_trigger", lambda: None)
    with pytest.raises(SequenceRefusedError) as caught:
        rig.orchestrator.capture(CaptureRequest(plan="full"))
    (finding,) = (f for f in caught.value.findings if f.fault is Fault.NO_TRIGGER)
    assert finding.device == "right camera"
    assert "call" in finding.message
    assert rig.is_safe


def test_exchanged_patterns_are_seen(stepped: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A projector that holds another pattern than it was told."""
    projector = stepped.devices.projector
    show, shown = projector.show, {}

    def wrong(pattern):
        if pattern is not None:
            shown[pattern.name] = pattern
            if pattern.name == "high_04":
                pattern = shown["high_02"].model_copy()
        show(pattern)

    monkeypatch.setattr(projector, "show", wrong)
    with pytest.raises(SequenceRefusedError) as caught:
        stepped.orchestrator.capture(CaptureRequest(plan="full"))
    assert any(f.fault is Fault.ORDER and f.pattern == "high_04" for f in caught.value.findings)


def test_it_can_be_cancelled(stepped: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    projector = stepped.devices.projector
    show = projector.show

    def slow(pattern) -> None:
        time.sleep(0.05)
        show(pattern)

    monkeypatch.setattr(projector, "show", slow)
    threading.Timer(0.3, stepped.orchestrator.cancel).start()
    with pytest.raises(CaptureCancelledError):
        stepped.orchestrator.capture(CaptureRequest(plan="full"))
    assert stepped.is_safe


@pytest.mark.parametrize(("left", "right", "why"), [(2000.0, 2000.0, "8333"), (9000.0, 12000.0, "multiple")])
def test_exposures_are_whole_passes(stepped: Rig, left: float, right: float, why: str) -> None:
    """A part of a flickering pattern has other grey values."""
    for side, exposure_us in (("left", left), ("right", right)):
        stepped.orchestrator.configure_camera(side, CameraSettings(exposure_us=exposure_us))  # type: ignore[arg-type]
    with pytest.raises(DriverError, match=why):
        stepped.orchestrator.capture(CaptureRequest(plan="full"))
    assert stepped.is_safe


def test_twice_as_long_is_two_passes(stepped: Rig) -> None:
    for side, exposure_us in (("left", 9000.0), ("right", 18_000.0)):
        stepped.orchestrator.configure_camera(side, CameraSettings(exposure_us=exposure_us))  # type: ignore[arg-type]
    assert stepped.orchestrator.capture(CaptureRequest(plan="full")).attempts == 1
