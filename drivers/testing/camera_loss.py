"""A camera that dies: who says so, and how to get it back."""

from __future__ import annotations

import pytest

from drivers.camera import Camera, CameraState, StreamStatistics, Trigger
from drivers.errors import DeviceLostError, DeviceStateError, DriverError
from drivers.testing.bench import CameraBench, short_settings
from drivers.testing.camera_frames import Waiting
from drivers.testing.camera_states import ALIVE, CALLS, bring
from drivers.testing.expect import assert_state, check_message, refused

_FIRST_CALL = {CameraState.OPEN: "configure", CameraState.CONFIGURED: "read_settings", CameraState.ARMED: "wait_frame"}
_LOST = (DeviceLostError, DeviceStateError)


class CameraLoss:
    """What happens once the device does not answer any more."""

    def test_waiting_for_a_frame_tells_of_the_loss(self, camera: Camera, bench: CameraBench) -> None:
        bench.armed(bench.quiet_trigger())
        bench.pull()
        with refused(camera, DeviceLostError, keeps_state=False):
            camera.wait_frame(bench.patience_s)
        assert_state(camera, CameraState.FAULT)

    def test_a_waiting_thread_is_told(self, camera: Camera, bench: CameraBench) -> None:
        bench.armed(bench.quiet_trigger())
        waiting = Waiting(camera)
        bench.pull()
        error = waiting.outcome(bench.patience_s)
        check_message(camera, error)
        assert isinstance(error, DeviceLostError)
        assert_state(camera, CameraState.FAULT)

    @pytest.mark.parametrize(("state", "call"), list(_FIRST_CALL.items()), ids=str)
    def test_the_next_call_finds_out(self, camera: Camera, bench: CameraBench, state: CameraState, call: str) -> None:
        """A driver that noticed by itself may say that its state allows nothing."""
        trigger = bench.quiet_trigger()
        bring(bench, state)
        bench.pull()
        with refused(camera, *_LOST, keeps_state=False):
            CALLS[call](camera, trigger)
        assert_state(camera, CameraState.FAULT)
        for other in ("open", "configure", "read_settings", "arm", "wait_frame"):
            with refused(camera, *_LOST):
                CALLS[other](camera, trigger)

    @pytest.mark.parametrize("state", [state for state in ALIVE if state is not CameraState.CLOSED], ids=str)
    def test_a_sign_of_life_is_asked_for_in_vain(self, camera: Camera, bench: CameraBench, state: CameraState) -> None:
        bring(bench, state)
        camera.check()
        assert_state(camera, state)
        bench.pull()
        for _ in range(2):
            with refused(camera, DeviceLostError, keeps_state=False):
                camera.check()
            assert_state(camera, CameraState.FAULT)
        camera.close()
        camera.check()
        assert_state(camera, CameraState.CLOSED)

    @pytest.mark.parametrize("noticed", [False, True], ids=["unnoticed", "noticed"])
    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_disarm_and_close_never_raise(
        self, camera: Camera, bench: CameraBench, state: CameraState, noticed: bool
    ) -> None:
        trigger = bench.quiet_trigger()
        bring(bench, state)
        bench.pull()
        if noticed and state in _FIRST_CALL:
            with refused(camera, *_LOST, keeps_state=False):
                CALLS[_FIRST_CALL[state]](camera, trigger)
        for _ in range(2):
            assert isinstance(camera.disarm(), StreamStatistics)
            assert camera.state != CameraState.ARMED
        for _ in range(2):
            camera.close()
            assert_state(camera, CameraState.CLOSED)

    def test_it_cannot_be_opened_while_it_is_gone(self, camera: Camera, bench: CameraBench) -> None:
        bench.pull()
        for _ in range(2):
            with refused(camera, DriverError):
                camera.open()

    def test_closed_and_opened_it_works_again(self, camera: Camera, bench: CameraBench) -> None:
        trigger = Trigger.HARDWARE_EDGE if bench.has(Trigger.HARDWARE_EDGE) else bench.quiet_trigger()
        bench.armed(trigger)
        info = camera.info
        bench.pull()
        with refused(camera, DeviceLostError, keeps_state=False):
            camera.wait_frame(bench.patience_s)
        camera.close()
        bench.replug()
        assert camera.open() == info
        camera.configure(short_settings(info.limits))
        camera.arm(1, trigger)
        if bench.has(trigger):
            bench.fire(trigger)
            assert camera.wait_frame(bench.patience_s).frame_id == info.first_frame_id
