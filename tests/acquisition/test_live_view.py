"""The live view runs only while somebody watches and nobody captures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from recorded_rig import RecordedRig, recorded_rig

from drivers.camera import CameraState
from service.acquisition.live import LiveFrame
from service.acquisition.request import CaptureRequest

PATIENCE_S = 10.0


@pytest.fixture
def rig(full_capture: Path) -> Iterator[RecordedRig]:
    rig = recorded_rig(full_capture)
    yield rig
    rig.orchestrator.close()


def _wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until, "it did not come to pass"
        time.sleep(0.005)


def _next(newest: Callable[[], LiveFrame | None], after: int = 0) -> LiveFrame:
    def came() -> bool:
        frame = newest()
        return frame is not None and frame.number > after

    _wait_for(came)
    frame = newest()
    assert frame is not None
    return frame


def _threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if "live" in thread.name]


def test_frames_come_while_watched_and_end_after(rig: RecordedRig) -> None:
    with rig.orchestrator.live.watch("left") as newest:
        first = _next(newest)
        assert _next(newest, first.number).number > first.number
        assert rig.devices.left.state is CameraState.ARMED
        assert rig.devices.right.state is not CameraState.ARMED
    _wait_for(lambda: not _threads())
    assert rig.is_safe


def test_a_watcher_gets_no_frame_from_before_it_came(rig: RecordedRig) -> None:
    live = rig.orchestrator.live
    with live.watch("left") as early:
        last = _next(early).number
    with live.watch("left") as late:
        assert _next(late).number > last


def test_a_capture_pauses_the_view_and_the_view_goes_on(rig: RecordedRig) -> None:
    with rig.orchestrator.live.watch("left") as newest:
        before = _next(newest)
        assert rig.orchestrator.capture(CaptureRequest()).attempts == 1
        assert _next(newest, before.number).number > before.number


def test_fifty_rounds_leave_no_thread(rig: RecordedRig) -> None:
    before = threading.active_count()
    for _ in range(50):
        with rig.orchestrator.live.watch("right") as newest:
            _next(newest)
            rig.orchestrator.capture(CaptureRequest())
    _wait_for(lambda: threading.active_count() <= before)


def test_closing_ends_it_under_a_watcher(rig: RecordedRig) -> None:
    with rig.orchestrator.live.watch("left") as newest:
        _next(newest)
        rig.orchestrator.close()
        assert not _threads()
        assert rig.orchestrator.live.closed
