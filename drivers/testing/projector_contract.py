"""Every promise of drivers/projector.py as a test."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from drivers.projector import Projector, ProjectorState
from drivers.testing.bench import ProjectorBench
from drivers.testing.expect import assert_no_new_threads, assert_state
from drivers.testing.projector_loss import ProjectorLoss
from drivers.testing.projector_sequences import ProjectorSequences
from drivers.testing.projector_states import ProjectorStates


class ProjectorContract(ProjectorStates, ProjectorSequences, ProjectorLoss):
    """Derive from it, supply the fixture ``bench``, and pytest collects the rest. The projector must keep real time."""

    @pytest.fixture
    def bench(self) -> ProjectorBench:
        """A closed projector, wired anew for each test."""
        raise NotImplementedError(f"{type(self).__name__} must supply the fixture 'bench'")

    @pytest.fixture
    def projector(self, bench: ProjectorBench) -> Iterator[Projector]:
        """The projector of the bench; after each test it closes and leaves no thread."""
        threads = set(threading.enumerate())
        yield bench.projector
        bench.projector.close()
        assert_state(bench.projector, ProjectorState.CLOSED)
        assert_no_new_threads(threads, bench.patience_s)
