"""A projector that dies: who says so, and how to get it back."""

from __future__ import annotations

import pytest

from drivers.errors import DeviceLostError, DeviceStateError, DriverError
from drivers.projector import Projector, ProjectorState
from drivers.testing.bench import ProjectorBench
from drivers.testing.expect import assert_state, refused, wait_until
from drivers.testing.projector_plans import showable
from drivers.testing.projector_sequences import run_to_the_end
from drivers.testing.projector_states import ALIVE, CALLS, bring

_LOST = (DeviceLostError, DeviceStateError)
_FIRST_CALL = {ProjectorState.OPEN: "load", ProjectorState.LOADED: "start", ProjectorState.HOLDING: "configure"}


class ProjectorLoss:
    """What happens once the device does not answer any more."""

    @pytest.mark.parametrize(("state", "call"), list(_FIRST_CALL.items()), ids=str)
    def test_the_next_call_finds_out(
        self, projector: Projector, bench: ProjectorBench, state: ProjectorState, call: str
    ) -> None:
        """A driver that noticed by itself may say that its state allows nothing."""
        bring(projector, state)
        info = projector.info
        bench.pull()
        with refused(projector, *_LOST, keeps_state=False):
            CALLS[call](projector, info)
        assert_state(projector, ProjectorState.FAULT)
        for other in ("open", "configure", "load", "start", "show"):
            with refused(projector, *_LOST):
                CALLS[other](projector, info)

    @pytest.mark.parametrize("state", [state for state in ALIVE if state is not ProjectorState.CLOSED], ids=str)
    def test_a_sign_of_life_is_asked_for_in_vain(
        self, projector: Projector, bench: ProjectorBench, state: ProjectorState
    ) -> None:
        bring(projector, state)
        projector.check()
        assert_state(projector, state)
        bench.pull()
        for _ in range(2):
            with refused(projector, DeviceLostError, keeps_state=False):
                projector.check()
            assert_state(projector, ProjectorState.FAULT)
        projector.close()
        projector.check()
        assert_state(projector, ProjectorState.CLOSED)

    def test_no_pulse_comes_from_a_dead_projector(self, projector: Projector, bench: ProjectorBench) -> None:
        bring(projector, ProjectorState.PROJECTING)
        bench.pull()
        sent = bench.pulses()
        assert not wait_until(lambda: bench.pulses() != sent, 0.7), "a dead projector sent a pulse"
        projector.stop()
        projector.close()
        assert_state(projector, ProjectorState.CLOSED)

    @pytest.mark.parametrize("state", ALIVE, ids=str)
    def test_stop_and_close_never_raise(
        self, projector: Projector, bench: ProjectorBench, state: ProjectorState
    ) -> None:
        bring(projector, state)
        bench.pull()
        for _ in range(2):
            projector.stop()
            assert projector.state not in (ProjectorState.PROJECTING, ProjectorState.HOLDING)
        for _ in range(2):
            projector.close()
            assert_state(projector, ProjectorState.CLOSED)

    def test_it_cannot_be_opened_while_it_is_gone(self, projector: Projector, bench: ProjectorBench) -> None:
        bench.pull()
        for _ in range(2):
            with refused(projector, DriverError):
                projector.open()

    def test_closed_and_opened_it_works_again(self, projector: Projector, bench: ProjectorBench) -> None:
        bring(projector, ProjectorState.LOADED)
        info = projector.info
        bench.pull()
        with refused(projector, *_LOST, keeps_state=False):
            projector.start()
        projector.close()
        bench.replug()
        assert projector.open() == info
        loaded = projector.load(showable(info, 2), 2 * info.limits.exposure_us[0])
        before = bench.pulses()
        projector.start()
        run_to_the_end(projector, bench, loaded)
        assert bench.pulses() - before == len(loaded.plan)
