"""States of a camera: what each call does in each of them, and leaving from anywhere."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.camera import Camera, CameraInfo, CameraSettings, CameraState, SoftwareTriggered, StreamStatistics, Trigger
from drivers.errors import DeviceStateError
from drivers.testing.bench import CameraBench, short_settings
from drivers.testing.expect import assert_state, refused

Call = Callable[[Camera, Trigger], object]
CALLS: dict[str, Call] = {
    "open": lambda camera, _: camera.open(),
    "info": lambda camera, _: camera.info,
    "configure": lambda camera, _: camera.configure(CameraSettings()),
    "read_settings": lambda camera, _: camera.read_settings(),
    "arm": lambda camera, trigger: camera.arm(1, trigger),
    "wait_frame": lambda camera, _: camera.wait_frame(0.05),
}
ILLEGAL = {
    CameraState.CLOSED: ("info", "configure", "read_settings", "arm", "wait_frame"),
    CameraState.OPEN: ("open", "read_settings", "arm", "wait_frame"),
    CameraState.CONFIGURED: ("open", "wait_frame"),
    CameraState.ARMED: ("open", "configure", "arm"),
}
ALIVE = tuple(ILLEGAL)


def bring(bench: CameraBench, state: CameraState) -> None:
    """Take a closed camera to a state."""
    if state in (CameraState.OPEN, CameraState.CONFIGURED, CameraState.ARMED):
        bench.camera.open()
    if state in (CameraState.CONFIGURED, CameraState.ARMED):
        bench.camera.configure(short_settings(bench.camera.info.limits))
    if state is CameraState.ARMED:
        bench.camera.arm(1, bench.quiet_trigger())
    assert_state(bench.camera, state)


class CameraStates:
    """The diagram of drivers/camera.py."""

    def test_a_new_camera_is_closed_and_has_a_name(self, camera: Camera) -> None:
        assert_state(camera, CameraState.CLOSED)
        assert camera.name
        assert camera.name == camera.name.strip()

    def test_info_is_what_open_returned(self, camera: Camera) -> None:
        info = camera.open()
        assert isinstance(camera, Camera)
        assert isinstance(info, CameraInfo)
        assert_state(camera, CameraState.OPEN)
        assert camera.info == info
        assert info.driver
        assert min(info.size) > 0
        assert info.first_frame_id >= 0
        assert 0 < info.limits.exposure_us[0] <= info.limits.exposure_us[1]
        assert info.limits.gain_db[0] <= info.limits.gain_db[1]
        assert set(info.limits.bit_depths) <= {8, 12}
        assert info.limits.bit_depths

    def test_the_way_there_and_back(self, camera: Camera, bench: CameraBench) -> None:
        trigger = bench.quiet_trigger()
        info = camera.open()
        camera.configure(short_settings(info.limits))
        assert_state(camera, CameraState.CONFIGURED)
        assert camera.info == info
        camera.arm(3, trigger)
        assert_state(camera, CameraState.ARMED)
        assert camera.info == info
        camera.disarm()
        assert_state(camera, CameraState.CONFIGURED)
        camera.configure(short_settings(info.limits))
        assert_state(camera, CameraState.CONFIGURED)
        camera.close()
        assert_state(camera, CameraState.CLOSED)

    @pytest.mark.parametrize(
        ("state", "call"), [(state, call) for state, calls in ILLEGAL.items() for call in calls], ids=str
    )
    def test_a_call_that_the_state_does_not_allow_changes_nothing(
        self, camera: Camera, bench: CameraBench, state: CameraState, call: str
    ) -> None:
        trigger = bench.quiet_trigger()
        bring(bench, state)
        with refused(camera, DeviceStateError):
            CALLS[call](camera, trigger)

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_software_triggers_only_while_armed_with_them(
        self, camera: Camera, bench: CameraBench, state: CameraState
    ) -> None:
        if not isinstance(camera, SoftwareTriggered):
            pytest.skip("no call can start this camera")
        if state is CameraState.ARMED:
            bench.armed(Trigger.FREE_RUN)
        else:
            bring(bench, state)
        with refused(camera, DeviceStateError):
            camera.software_trigger()

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_disarm_is_allowed_everywhere(self, camera: Camera, bench: CameraBench, state: CameraState) -> None:
        bring(bench, state)
        after = CameraState.CONFIGURED if state is CameraState.ARMED else state
        for _ in range(2):
            assert isinstance(camera.disarm(), StreamStatistics)
            assert_state(camera, after)

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_close_is_allowed_everywhere_and_open_works_again(
        self, camera: Camera, bench: CameraBench, state: CameraState
    ) -> None:
        bring(bench, state)
        for _ in range(2):
            camera.close()
            assert_state(camera, CameraState.CLOSED)
        with refused(camera, DeviceStateError):
            _ = camera.info
        bench.configured()
        assert_state(camera, CameraState.CONFIGURED)

    def test_a_reopened_camera_is_the_same_and_must_be_configured_again(
        self, camera: Camera, bench: CameraBench
    ) -> None:
        trigger = bench.quiet_trigger()
        info = camera.open()
        camera.configure(short_settings(info.limits))
        camera.close()
        assert camera.open() == info
        with refused(camera, DeviceStateError):
            camera.arm(1, trigger)
