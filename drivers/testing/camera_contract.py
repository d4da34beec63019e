"""Every promise of drivers/camera.py as a test."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from drivers.camera import Camera, CameraState
from drivers.testing.bench import CameraBench
from drivers.testing.camera_frames import CameraFrames
from drivers.testing.camera_loss import CameraLoss
from drivers.testing.camera_settings import CameraConfiguration
from drivers.testing.camera_states import CameraStates
from drivers.testing.expect import assert_no_new_threads, assert_state


class CameraContract(CameraStates, CameraConfiguration, CameraFrames, CameraLoss):
    """Derive from it, supply the fixture ``bench``, and pytest collects the rest."""

    @pytest.fixture
    def bench(self) -> CameraBench:
        """A closed camera, wired anew for each test."""
        raise NotImplementedError(f"{type(self).__name__} must supply the fixture 'bench'")

    @pytest.fixture
    def camera(self, bench: CameraBench) -> Iterator[Camera]:
        """The camera of the bench; after each test it closes and leaves no thread."""
        threads = set(threading.enumerate())
        yield bench.camera
        bench.camera.close()
        assert_state(bench.camera, CameraState.CLOSED)
        assert_no_new_threads(threads, bench.patience_s)
