"""The rig as a whole: one at a time, cancellable, always safe, reconnectable."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from recorded_rig import RecordedRig, recorded_rig
from simulated_captures import only

from drivers.camera import CameraSettings, CameraState
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, SequenceInvalidError
from drivers.projector import ProjectorSettings, ProjectorState
from drivers.virtual.camera import VirtualCamera
from drivers.virtual.faults import PlantedFault
from models.capture import read_capture, write_capture
from service.acquisition.cancellation import CaptureCancelledError
from service.acquisition.lock import RigBusyError
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError, SceneError
from service.acquisition.plans import PlanError
from service.acquisition.request import CaptureRequest

COMPOSITE = CaptureRequest()


@pytest.fixture
def rig(full_capture: Path) -> Iterator[RecordedRig]:
    rig = recorded_rig(full_capture)
    yield rig
    rig.orchestrator.close()


class TestCapture:
    @pytest.mark.parametrize("plan", ["composite", "reference", "full"])
    def test_gives_the_plan_in_order(self, rig: RecordedRig, full_capture: Path, plan: str) -> None:
        outcome = rig.orchestrator.capture(CaptureRequest(plan=plan, object_id="cup", notes="first"))
        recorded = read_capture(full_capture / "plate")
        wanted = {"composite": ("composite",), "full": recorded.plan.names}
        names = wanted.get(plan, tuple(n for n in recorded.plan.names if n != "composite"))
        assert outcome.capture.plan.names == names
        record = outcome.capture.record
        assert record.object_id == "cup"
        assert record.model_extra is not None
        assert record.model_extra["notes"] == "first"
        assert {device.origin for device in record.devices} == {"replayed"}
        assert all(len(ids) == len(names) for ids in record.frame_ids.values())
        assert outcome.attempts == 1
        assert outcome.acquisition_s > 0
        assert rig.is_safe

    def test_a_list_of_patterns_is_a_plan(self, rig: RecordedRig) -> None:
        names = ("white", *(f"high_{k:02d}" for k in range(9)), "black")
        assert rig.orchestrator.capture(CaptureRequest(plan=names)).capture.plan.names == names

    @pytest.mark.parametrize("plan", ["colour", ("high_00",), (), ("gray_inv_00",), ("white", "white")])
    def test_a_plan_that_cannot_be_decoded_moves_nothing(self, rig: RecordedRig, plan: str | tuple[str, ...]) -> None:
        before = rig.bench.pulses_sent
        with pytest.raises(PlanError):
            rig.orchestrator.capture(CaptureRequest(plan=plan))
        assert rig.bench.pulses_sent == before
        assert rig.is_safe

    def test_a_plan_without_what_is_needed_moves_nothing(self, rig: RecordedRig) -> None:
        before = rig.bench.pulses_sent
        with pytest.raises(PlanError, match="high"):
            rig.orchestrator.capture(COMPOSITE, needs=frozenset({"high"}))
        assert rig.bench.pulses_sent == before

    def test_exposure_of_one_capture_does_not_stay(self, rig: RecordedRig) -> None:
        outcome = rig.orchestrator.capture(CaptureRequest(exposure_us=20_000))
        assert outcome.capture.record.settings["exposure_us"] == 20_000
        assert outcome.capture.plan.patterns[0].exposure_us == 20_000
        assert rig.orchestrator.settings.cameras["left"].exposure_us == CameraSettings().exposure_us

    def test_an_exposure_too_short_for_eight_bits_is_refused(self, rig: RecordedRig) -> None:
        with pytest.raises(SequenceInvalidError, match="composite"):
            rig.orchestrator.capture(CaptureRequest(exposure_us=2_000))
        assert rig.is_safe

    def test_truth_and_calibration_come_along(self, rig: RecordedRig, full_capture: Path) -> None:
        capture = rig.orchestrator.capture(COMPOSITE).capture
        recorded = read_capture(full_capture / "plate")
        assert capture.rig == recorded.rig
        assert capture.truth is not None
        assert recorded.truth is not None
        np.testing.assert_array_equal(capture.truth.depth, recorded.truth.depth)


class TestOneAtATime:
    def test_the_second_learns_at_once_that_it_is_busy(self, rig: RecordedRig) -> None:
        release, held = threading.Event(), threading.Event()

        def hold() -> None:
            with rig.orchestrator._exclusively("capture"):
                held.set()
                release.wait(10)

        with ThreadPoolExecutor(1) as pool:
            holder = pool.submit(hold)
            assert held.wait(5)
            began = time.monotonic()
            with pytest.raises(RigBusyError, match="capture") as caught:
                rig.orchestrator.capture(COMPOSITE)
            assert time.monotonic() - began < 2
            assert caught.value.retry_after_s >= 1
            release.set()
            holder.result()
        assert rig.orchestrator.capture(COMPOSITE).attempts == 1

    def test_cancelling_ends_a_capture_that_waits(self, rig: RecordedRig) -> None:
        """A projector that does not start would be waited for; the cancellation is seen meanwhile."""
        rig.bench.plant(PlantedFault("not_started", sequences=None))
        with ThreadPoolExecutor(1) as pool:
            capture = pool.submit(rig.orchestrator.capture, CaptureRequest(plan="full"))
            until = time.monotonic() + 10
            while not rig.orchestrator.cancel():
                assert time.monotonic() < until
                time.sleep(0.005)
            with pytest.raises(CaptureCancelledError):
                capture.result(timeout=10)
        assert rig.is_safe
        assert not rig.orchestrator.cancel()
        rig.bench.clear_faults()
        assert rig.orchestrator.capture(COMPOSITE).attempts == 1


class TestConnection:
    def test_captures_need_a_connected_rig(self, rig: RecordedRig) -> None:
        rig.orchestrator.disconnect()
        assert not rig.orchestrator.connected
        with pytest.raises(RigNotConnectedError):
            rig.orchestrator.capture(COMPOSITE)
        rig.orchestrator.connect()
        assert rig.orchestrator.capture(COMPOSITE).attempts == 1

    def test_all_failures_are_told_together(self, rig: RecordedRig) -> None:
        rig.orchestrator.disconnect()
        for camera in (rig.devices.left, rig.devices.right):
            assert isinstance(camera, VirtualCamera)
            camera.unplug()
        with pytest.raises(RigNotConnectedError) as caught:
            rig.orchestrator.connect()
        assert set(caught.value.failures) == {"left camera", "right camera"}
        assert rig.devices.projector.state is ProjectorState.OPEN
        assert set(rig.orchestrator.failures) == {"left camera", "right camera"}

    def test_a_lost_camera_is_opened_again_by_the_next_capture(self, rig: RecordedRig) -> None:
        assert isinstance(rig.devices.left, VirtualCamera)
        rig.devices.left.unplug()
        with pytest.raises(RigNotConnectedError, match="left camera"):
            rig.orchestrator.connect()
        rig.devices.left.plug()
        assert rig.orchestrator.capture(COMPOSITE).attempts == 1

    def test_closing_closes_everything(self, full_capture: Path) -> None:
        rig = recorded_rig(full_capture)
        rig.orchestrator.close()
        assert rig.devices.left.state is CameraState.CLOSED
        assert rig.devices.right.state is CameraState.CLOSED
        assert rig.devices.projector.state is ProjectorState.CLOSED


class TestSettings:
    def test_what_the_device_refuses_is_not_kept(self, rig: RecordedRig) -> None:
        with pytest.raises(DeviceConfigurationError, match="gain"):
            rig.orchestrator.configure_camera("left", CameraSettings(gain_db=99))
        assert rig.orchestrator.settings.cameras["left"] == CameraSettings()

    def test_settings_hold_for_captures(self, rig: RecordedRig) -> None:
        for side in ("left", "right"):
            rig.orchestrator.configure_camera(side, CameraSettings(exposure_us=10_000, gain_db=3))
        rig.orchestrator.configure_projector(ProjectorSettings(brightness=0.5))
        settings = rig.orchestrator.capture(COMPOSITE).capture.record.settings
        assert settings["exposure_us"] == 10_000
        assert settings["cameras"]["right"]["gain_db"] == pytest.approx(3)
        assert settings["projector"]["brightness"] == 0.5


class TestScenes:
    def test_needs_are_those_of_the_capture_whose_turn_it_is(self, full_capture: Path, tmp_path: Path) -> None:
        """The first recorded capture has no composite, the second has."""
        recorded = read_capture(full_capture / "plate")
        write_capture(only(recorded, {"white", "high", "low", "gray", "black"}), tmp_path / "a")
        write_capture(only(recorded, {"composite"}), tmp_path / "b")
        rig = recorded_rig(tmp_path)
        assert rig.orchestrator.capture(CaptureRequest(plan="reference"), needs=frozenset({"high"})).attempts == 1
        assert rig.orchestrator.capture(COMPOSITE, needs=frozenset({"composite", "high"})).attempts == 1
        rig.orchestrator.close()

    def test_an_unknown_scene_is_refused(self, rig: RecordedRig) -> None:
        with pytest.raises(SceneError, match="nowhere"):
            rig.orchestrator.capture(CaptureRequest(scene="../nowhere"))
        assert rig.orchestrator.capture(CaptureRequest(scene="plate")).attempts == 1

    def test_a_real_rig_has_no_scenes(self, rig: RecordedRig) -> None:
        devices = RigDevices(rig.devices.left, rig.devices.right, rig.devices.projector)
        orchestrator = Orchestrator(devices)
        with pytest.raises(SceneError, match="real scene"):
            orchestrator.capture(CaptureRequest(scene="plate"))
