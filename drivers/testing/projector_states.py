"""States of a projector: what each call does in each of them, and leaving from anywhere."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.errors import DeviceStateError
from drivers.projector import Projector, ProjectorInfo, ProjectorSettings, ProjectorState
from drivers.testing.bench import ProjectorBench
from drivers.testing.expect import assert_state, refused, wait_until
from drivers.testing.projector_plans import showable

SLOW_PERIOD_US = 300_000.0
"""Time between patterns in tests that act while a sequence runs."""
CALLS: dict[str, Callable[[Projector, ProjectorInfo], object]] = {
    "open": lambda projector, _: projector.open(),
    "info": lambda projector, _: projector.info,
    "configure": lambda projector, _: projector.configure(ProjectorSettings(brightness=0.5)),
    "load": lambda projector, info: projector.load(showable(info, 1), 2 * info.limits.exposure_us[0]),
    "start": lambda projector, _: projector.start(),
    "show": lambda projector, info: projector.show(showable(info, 1).patterns[0]),
}
ILLEGAL = {
    ProjectorState.CLOSED: ("info", "configure", "load", "start", "show"),
    ProjectorState.OPEN: ("open", "start"),
    ProjectorState.LOADED: ("open",),
    ProjectorState.PROJECTING: ("open", "configure", "load", "start", "show"),
    ProjectorState.HOLDING: ("open", "start"),
}
ALIVE = tuple(ILLEGAL)
_AFTER_STOP = {ProjectorState.PROJECTING: ProjectorState.LOADED, ProjectorState.HOLDING: ProjectorState.OPEN}


def bring(projector: Projector, state: ProjectorState) -> None:
    """Take a closed projector to a state."""
    if state is ProjectorState.CLOSED:
        return
    info = projector.open()
    if state in (ProjectorState.LOADED, ProjectorState.PROJECTING):
        projector.load(showable(info, 3), SLOW_PERIOD_US)
    if state is ProjectorState.PROJECTING:
        projector.start()
    if state is ProjectorState.HOLDING:
        projector.show(showable(info, 1).patterns[0])
    assert_state(projector, state)


class ProjectorStates:
    """The diagram of drivers/projector.py."""

    def test_a_new_projector_is_closed_and_has_a_name(self, projector: Projector) -> None:
        assert_state(projector, ProjectorState.CLOSED)
        assert projector.name
        assert projector.name == projector.name.strip()

    def test_info_is_what_open_returned(self, projector: Projector) -> None:
        info = projector.open()
        assert isinstance(projector, Projector)
        assert_state(projector, ProjectorState.OPEN)
        assert projector.info == info
        assert info.driver
        assert 0 < info.limits.exposure_us[0] <= info.limits.exposure_us[1]
        assert info.limits.binary_exposure_us <= info.limits.exposure_us[0]
        assert info.limits.patterns >= 1
        assert info.stored is None or len(info.stored) >= 1

    @pytest.mark.parametrize(
        ("state", "call"), [(state, call) for state, calls in ILLEGAL.items() for call in calls], ids=str
    )
    def test_a_call_that_the_state_does_not_allow_changes_nothing(
        self, projector: Projector, state: ProjectorState, call: str
    ) -> None:
        info = projector.open()
        projector.close()
        bring(projector, state)
        with refused(projector, DeviceStateError):
            CALLS[call](projector, info)

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_stop_is_allowed_everywhere(self, projector: Projector, state: ProjectorState) -> None:
        bring(projector, state)
        for _ in range(2):
            projector.stop()
            assert projector.state == _AFTER_STOP.get(state, state)

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_close_is_allowed_everywhere_and_open_works_again(
        self, projector: Projector, bench: ProjectorBench, state: ProjectorState
    ) -> None:
        bring(projector, state)
        for _ in range(2):
            projector.close()
            assert_state(projector, ProjectorState.CLOSED)
        sent = bench.pulses()
        info = projector.open()
        assert isinstance(projector, Projector)
        assert_state(projector, ProjectorState.OPEN)
        with refused(projector, DeviceStateError):
            projector.start()
        projector.load(showable(info, 2), 2 * info.limits.exposure_us[0])
        assert bench.pulses() == sent

    @pytest.mark.parametrize("state", [ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING], ids=str)
    def test_brightness_reads_back_and_keeps_the_state(self, projector: Projector, state: ProjectorState) -> None:
        bring(projector, state)
        for brightness in (0.0, 0.5, 1.0):
            assert projector.configure(ProjectorSettings(brightness=brightness)).brightness == pytest.approx(
                brightness, abs=0.01
            )
            assert_state(projector, state)

    @pytest.mark.parametrize("state", [ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING], ids=str)
    def test_a_pattern_is_held_until_dark(
        self, projector: Projector, bench: ProjectorBench, state: ProjectorState
    ) -> None:
        bring(projector, state)
        for pattern in showable(projector.info, 2).patterns:
            projector.show(pattern)
            assert_state(projector, ProjectorState.HOLDING)
        sent = bench.pulses()
        assert not wait_until(lambda: bench.pulses() > sent + 1, 0.1), "a held pattern sent pulse after pulse"
        projector.show(None)
        assert_state(projector, ProjectorState.OPEN)

    def test_loading_ends_the_holding(self, projector: Projector) -> None:
        bring(projector, ProjectorState.HOLDING)
        projector.load(showable(projector.info, 2), SLOW_PERIOD_US)
        assert_state(projector, ProjectorState.LOADED)
