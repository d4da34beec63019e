"""The rig while nobody captures: what is lost is noticed and comes back, and nobody is kept waiting for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from recorded_rig import RecordedRig, recorded_rig

from drivers.camera import CameraState
from drivers.errors import DeviceLostError
from drivers.projector import ProjectorState
from service.acquisition.lock import RigBusyError, RigLock
from service.acquisition.orchestrator import Orchestrator, RigNotConnectedError
from service.acquisition.request import CaptureRequest
from service.acquisition.settings import AcquisitionSettings
from service.acquisition.watch import RigWatch

COMPOSITE = CaptureRequest(plan="composite")


@pytest.fixture
def rig(full_capture: Path) -> Iterator[RecordedRig]:
    rig = recorded_rig(full_capture)
    yield rig
    rig.orchestrator.close()


def until(reached: Callable[[], bool], patience_s: float = 5.0) -> bool:
    deadline = time.monotonic() + patience_s
    while not reached():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


class TestLooking:
    def test_what_is_well_is_left_alone(self, rig: RecordedRig) -> None:
        states = [rig.devices.left.state, rig.devices.right.state, rig.devices.projector.state]
        rig.orchestrator.look_after()
        assert states == [rig.devices.left.state, rig.devices.right.state, rig.devices.projector.state]

    def test_what_was_lost_comes_back(self, rig: RecordedRig) -> None:
        rig.devices.projector.unplug()  # type: ignore[attr-defined]
        rig.orchestrator.look_after()
        assert set(rig.orchestrator.failures) == {"projector"}
        rig.devices.projector.plug()  # type: ignore[attr-defined]
        rig.orchestrator.look_after()
        assert rig.orchestrator.failures == {}
        assert rig.orchestrator.connected

    def test_a_rig_that_was_disconnected_stays_so(self, rig: RecordedRig) -> None:
        rig.orchestrator.disconnect()
        rig.orchestrator.look_after()
        assert not rig.orchestrator.connected

    def test_a_rig_that_was_closed_stays_so(self, rig: RecordedRig) -> None:
        rig.devices.left.unplug()  # type: ignore[attr-defined]
        rig.orchestrator.look_after()
        rig.orchestrator.close()
        rig.devices.left.plug()  # type: ignore[attr-defined]
        rig.orchestrator.look_after()
        with pytest.raises(RigNotConnectedError):
            rig.orchestrator.capture(COMPOSITE)
        assert rig.devices.left.state is CameraState.CLOSED
        assert rig.devices.projector.state is ProjectorState.CLOSED

    def test_connecting_finds_what_was_lost_unnoticed(self, rig: RecordedRig, monkeypatch: pytest.MonkeyPatch) -> None:
        """A device that was switched off and on is open by name only."""
        projector, opened = rig.devices.projector, []

        def gone() -> None:
            monkeypatch.undo()
            projector.unplug()  # type: ignore[attr-defined]
            projector.plug()  # type: ignore[attr-defined]
            opened.append("lost")
            raise DeviceLostError("projector", "does not answer any more")

        monkeypatch.setattr(projector, "check", gone)
        rig.orchestrator.connect()
        assert opened == ["lost"]
        assert projector.state is ProjectorState.OPEN

    def test_a_device_lost_during_the_live_view_is_noticed(
        self, rig: RecordedRig, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("service.acquisition.live._ASK_S", 0.05)
        projector = rig.devices.projector
        with rig.orchestrator.live.watch("left") as newest:
            assert until(lambda: newest() is not None)
            projector.unplug()  # type: ignore[attr-defined]
            rig.orchestrator.look_after()
            assert set(rig.orchestrator.failures) == {"projector"}
            projector.plug()  # type: ignore[attr-defined]
            rig.orchestrator.look_after()
            assert rig.orchestrator.connected
            number = newest().number  # type: ignore[union-attr]
            assert until(lambda: newest().number > number)  # type: ignore[union-attr]
            assert projector.state is ProjectorState.HOLDING


class TestWatch:
    def test_it_goes_on_after_a_failure(self, full_capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        rig = recorded_rig(full_capture)
        orchestrator = Orchestrator(rig.devices, AcquisitionSettings(watch_s=0.02))
        looks: list[int] = []

        def look() -> None:
            looks.append(len(looks))
            if len(looks) == 1:
                raise OSError("too many open files")

        monkeypatch.setattr(orchestrator, "look_after", look)
        watch = RigWatch(orchestrator)
        assert until(lambda: len(looks) > 2)
        watch.close()
        seen = len(looks)
        time.sleep(0.1)
        assert len(looks) == seen
        rig.orchestrator.close()

    def test_it_can_be_switched_off(self, full_capture: Path) -> None:
        rig = recorded_rig(full_capture)
        before = threading.active_count()
        watch = RigWatch(Orchestrator(rig.devices, AcquisitionSettings(watch_s=0)))
        assert threading.active_count() == before
        watch.close()
        rig.orchestrator.close()


class TestLock:
    def test_background_work_gives_way_to_nobody_else(self) -> None:
        lock = RigLock(0.01)
        with lock.hold("capture"), pytest.raises(RigBusyError), lock.hold("looking", background=True):
            pass

    def test_others_wait_for_background_work_and_it_learns_of_them(self) -> None:
        lock = RigLock(0.01)
        held = []

        def capture() -> None:
            with lock.hold("capture"):
                held.append(lock.holder)

        waiting = threading.Thread(target=capture)
        with lock.hold("looking", background=True):
            assert lock.holder is None
            assert not lock.wanted
            waiting.start()
            assert until(lambda: lock.wanted)
            time.sleep(0.1)
            assert held == []
        waiting.join()
        assert held == ["capture"]
        assert not lock.wanted

    def test_looking_ends_with_the_device_it_is_at_once_somebody_waits(
        self, rig: RecordedRig, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        left, right = rig.devices.left, rig.devices.right
        for camera in (left, right):
            camera.unplug()  # type: ignore[attr-defined]
        opened = left.open
        waiting = threading.Thread(target=rig.orchestrator.disconnect)

        def slow() -> object:
            waiting.start()
            assert until(lambda: rig.orchestrator._lock.wanted)
            return opened()

        monkeypatch.setattr(left, "open", slow)
        monkeypatch.setattr(right, "open", lambda: pytest.fail("it did not give way"))
        rig.orchestrator.look_after()
        waiting.join(5)
        assert not waiting.is_alive()
        assert not rig.orchestrator.connected
