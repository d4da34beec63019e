"""Sequences of a projector: what may be loaded, and what is shown."""

from __future__ import annotations

import time

import pytest

from drivers.errors import SequenceInvalidError
from drivers.projector import LoadedSequence, Projector, ProjectorState
from drivers.testing.bench import ProjectorBench
from drivers.testing.expect import assert_state, refused, wait_until
from drivers.testing.projector_plans import (
    eight_bit_index,
    showable,
    too_long,
    unknown_pattern,
    with_exposure,
)
from drivers.testing.projector_states import SLOW_PERIOD_US, bring
from models.patterns import MAXIMUM_STEPS, PatternPlan


class ProjectorSequences:
    """What ``load``, ``start`` and ``stop`` promise."""

    @pytest.mark.parametrize("period_factor", [1.0, 1.5, 4.0])
    @pytest.mark.parametrize("count", [1, 4])
    def test_pulses_are_as_many_as_patterns_and_no_closer_than_the_period(
        self, projector: Projector, bench: ProjectorBench, count: int, period_factor: float
    ) -> None:
        info = projector.open()
        plan = showable(info, count)
        period_us = period_factor * info.limits.exposure_us[0]
        loaded = projector.load(plan, period_us)
        assert_state(projector, ProjectorState.LOADED)
        assert loaded.plan.names == plan.names
        check_times(loaded, period_us)
        assert bench.pulses() == 0, "loading sent a pulse"

    def test_a_missing_exposure_is_refused_by_name(self, projector: Projector) -> None:
        plan = showable(projector.open(), 2)
        self._refuse(projector, with_exposure(plan, 1, None), SLOW_PERIOD_US, plan.names[1])

    def test_eight_bits_need_their_time(self, projector: Projector) -> None:
        info = projector.open()
        plan = showable(info, info.limits.patterns)
        index = eight_bit_index(plan)
        if index is None:
            pytest.skip("the projector stores no 8-bit pattern")
        short = with_exposure(plan, index, info.limits.exposure_us[0] - 10)
        self._refuse(projector, short, SLOW_PERIOD_US, plan.names[index])

    def test_two_colours_need_less_time(self, projector: Projector) -> None:
        info = projector.open()
        plan = showable(info, info.limits.patterns)
        index = next((i for i, p in enumerate(plan.patterns) if p.is_gray or p.is_uniform), None)
        if index is None:
            pytest.skip("the projector stores no 1-bit pattern")
        plan = PatternPlan(name="binary", patterns=(plan.patterns[index],))
        least_us = info.limits.binary_exposure_us
        self._refuse(projector, with_exposure(plan, 0, 0.5 * least_us), SLOW_PERIOD_US, plan.names[0])
        loaded = projector.load(with_exposure(plan, 0, least_us), least_us)
        check_times(loaded, least_us)

    def test_an_exposure_beyond_the_longest_is_refused_by_name(self, projector: Projector) -> None:
        info = projector.open()
        plan = showable(info, 2)
        longest_us = info.limits.exposure_us[1]
        self._refuse(projector, with_exposure(plan, 0, 1.01 * longest_us), 2 * longest_us, plan.names[0])

    def test_an_exposure_longer_than_the_period_is_refused_by_name(self, projector: Projector) -> None:
        info = projector.open()
        plan = showable(info, 2)
        least_us = info.limits.exposure_us[0]
        self._refuse(projector, with_exposure(plan, 1, 1.5 * least_us), 1.2 * least_us, plan.names[1])

    def test_a_plan_that_is_too_long_is_refused(self, projector: Projector) -> None:
        info = projector.open()
        if info.limits.patterns >= MAXIMUM_STEPS:
            pytest.skip("no plan is too long for this projector")
        self._refuse(projector, too_long(info), SLOW_PERIOD_US)

    def test_a_pattern_that_is_not_stored_is_refused_by_name(self, projector: Projector) -> None:
        info = projector.open()
        if info.stored is None:
            pytest.skip("the projector shows any pattern")
        unknown = unknown_pattern(info)
        self._refuse(projector, PatternPlan(patterns=(unknown,)), SLOW_PERIOD_US, unknown.name)
        with refused(projector, SequenceInvalidError) as caught:
            projector.show(unknown)
        assert unknown.name in str(caught.value)

    def test_a_refused_plan_is_not_what_start_shows(self, projector: Projector, bench: ProjectorBench) -> None:
        info = projector.open()
        loaded = projector.load(showable(info, 3), 2 * info.limits.exposure_us[0])
        with refused(projector, SequenceInvalidError, keeps_state=False):
            projector.load(with_exposure(showable(info, 1), 0, None), SLOW_PERIOD_US)
        assert projector.state in (ProjectorState.OPEN, ProjectorState.LOADED)
        if projector.state == ProjectorState.LOADED:
            self._run(projector, bench, loaded)

    @pytest.mark.parametrize("count", [1, 4])
    def test_each_start_shows_the_sequence_once(self, projector: Projector, bench: ProjectorBench, count: int) -> None:
        info = projector.open()
        loaded = projector.load(showable(info, count), 2 * info.limits.exposure_us[0])
        for _ in range(3):
            self._run(projector, bench, loaded)

    def test_the_last_sequence_loaded_is_shown(self, projector: Projector, bench: ProjectorBench) -> None:
        info = projector.open()
        period_us = 2 * info.limits.exposure_us[0]
        projector.load(showable(info, 4), period_us)
        self._run(projector, bench, projector.load(showable(info, 2), period_us))

    def test_start_returns_at_once_and_stop_ends_the_pulses(self, projector: Projector, bench: ProjectorBench) -> None:
        bring(projector, ProjectorState.LOADED)
        start = time.monotonic()
        projector.start()
        assert time.monotonic() - start < 1e-6 * SLOW_PERIOD_US, "start waited for a pattern"
        assert_state(projector, ProjectorState.PROJECTING)
        assert wait_until(lambda: bench.pulses() >= 1, bench.patience_s)
        projector.stop()
        assert_state(projector, ProjectorState.LOADED)
        sent = bench.pulses()
        assert sent < 3, "the sequence did not keep its time"
        assert not wait_until(lambda: bench.pulses() != sent, 2.5e-6 * SLOW_PERIOD_US), "a pulse came after stop"

    def test_after_a_stop_the_sequence_starts_from_its_beginning(
        self, projector: Projector, bench: ProjectorBench
    ) -> None:
        info = projector.open()
        loaded = projector.load(showable(info, 4), 2 * info.limits.exposure_us[0])
        projector.start()
        projector.stop()
        self._run(projector, bench, loaded)

    def test_close_ends_the_pulses(self, projector: Projector, bench: ProjectorBench) -> None:
        bring(projector, ProjectorState.PROJECTING)
        projector.close()
        sent = bench.pulses()
        assert not wait_until(lambda: bench.pulses() != sent, 1.5e-6 * SLOW_PERIOD_US), "a pulse came after close"

    @staticmethod
    def _refuse(projector: Projector, plan: PatternPlan, period_us: float, names: str = "") -> None:
        with refused(projector, SequenceInvalidError) as caught:
            projector.load(plan, period_us)
        assert names in str(caught.value), f"the error does not name the pattern {names}"

    @staticmethod
    def _run(projector: Projector, bench: ProjectorBench, loaded: LoadedSequence) -> None:
        """Show once, wait for the end, count the pulses."""
        before = bench.pulses()
        projector.start()
        run_to_the_end(projector, bench, loaded)
        assert bench.pulses() - before == len(loaded.plan)


def run_to_the_end(projector: Projector, bench: ProjectorBench, loaded: LoadedSequence) -> None:
    """Wait until a started projector has shown everything."""
    patience_s = 1e-6 * loaded.duration_us + bench.patience_s
    assert wait_until(lambda: projector.state != ProjectorState.PROJECTING, patience_s), "the sequence does not end"
    assert_state(projector, ProjectorState.LOADED)


def check_times(loaded: LoadedSequence, period_us: float) -> None:
    """Pulses count from 0, keep the period, leave each pattern its exposure, and end before the sequence does."""
    pulses = loaded.pulses_us
    assert len(pulses) == len(loaded.plan)
    assert pulses[0] == 0.0
    lit_us = [pattern.exposure_us or 0.0 for pattern in loaded.plan.patterns]
    for k in range(1, len(pulses)):
        gap_us = pulses[k] - pulses[k - 1]
        assert gap_us >= max(period_us, lit_us[k - 1]) - 1e-3
    assert loaded.duration_us >= pulses[-1] + lit_us[-1] - 1e-3
