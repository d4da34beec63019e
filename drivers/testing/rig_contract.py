"""Two cameras and the projector that triggers them, together."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from drivers.camera import Camera, EdgeTriggered, Frame, Trigger, supported_triggers
from drivers.devices import RigDevices
from drivers.errors import FrameTimeoutError
from drivers.projector import LoadedSequence, ProjectorState
from drivers.testing.bench import as_asked, short_settings
from drivers.testing.camera_frames import check_frame, check_sequence
from drivers.testing.expect import assert_no_new_threads, refused, wait_until
from drivers.testing.projector_plans import showable
from models.geometry.rig import SIDES, Side
from models.patterns import PatternPlan

_INTERVAL_SHARE = 0.05
_INTERVAL_LEAST_NS = 2000
"""Two ticks of a coarse camera clock."""


class RigContract:
    """Derive from it, supply the fixture ``rig``, and pytest collects the rest.

    sees_light: whether the cameras see what the projector shows. patience_s: as for CameraBench.
    """

    sees_light = True
    patience_s = 5.0

    @pytest.fixture
    def rig(self) -> RigDevices:
        """Three closed devices on one trigger line, wired anew for each test."""
        raise NotImplementedError(f"{type(self).__name__} must supply the fixture 'rig'")

    @pytest.fixture
    def ready(self, rig: RigDevices) -> Iterator[RigDevices]:
        """The rig with open devices and configured cameras; after each test it closes and leaves no thread."""
        threads = set(threading.enumerate())
        rig.projector.open()
        for camera in rig.cameras.values():
            camera.configure(short_settings(camera.open().limits))
        yield rig
        rig.projector.close()
        for camera in rig.cameras.values():
            camera.close()
        assert_no_new_threads(threads, self.patience_s)

    def test_names_tell_the_devices_apart(self, rig: RigDevices) -> None:
        names = {rig.left.name, rig.right.name, rig.projector.name}
        assert len(names) == 3
        assert all(Trigger.HARDWARE_EDGE in supported_triggers(camera) for camera in rig.cameras.values())

    @pytest.mark.parametrize("count", [1, 5])
    def test_each_camera_gets_one_frame_a_pattern_at_the_time_of_its_pulse(self, ready: RigDevices, count: int) -> None:
        """Twice, without configuring anew."""
        loaded = self._load(ready, count)
        for _ in range(2):
            frames = self._sequence(ready, loaded)
            for side, camera in ready.cameras.items():
                check_sequence(frames[side], camera.info.first_frame_id)
                for frame in frames[side]:
                    check_frame(frame, camera.read_settings())
                self._check_times(frames[side], loaded)
                with refused(camera, FrameTimeoutError):
                    camera.wait_frame(0.05)
                statistics = camera.disarm()
                assert (statistics.delivered, statistics.unclaimed, statistics.lost) == (len(loaded.plan), 0, 0)

    def test_a_camera_that_is_not_armed_does_not_hold_the_other_up(self, ready: RigDevices) -> None:
        loaded = self._load(ready, 3)
        ready.left.arm(len(loaded.plan), Trigger.HARDWARE_EDGE)
        ready.projector.start()
        frames = self._collect(ready.left, loaded)
        check_sequence(frames, ready.left.info.first_frame_id)
        assert wait_until(lambda: ready.projector.state == ProjectorState.LOADED, self.patience_s)
        ready.right.arm(1, Trigger.HARDWARE_EDGE)
        with refused(ready.right, FrameTimeoutError):
            ready.right.wait_frame(0.05)

    def test_a_stopped_sequence_leaves_both_cameras_with_the_same_frames(self, ready: RigDevices) -> None:
        loaded = self._load(ready, 6)
        self._arm(ready, loaded)
        ready.projector.start()
        ready.projector.stop()
        time.sleep(0.1)
        counts = [camera.disarm().unclaimed for camera in ready.cameras.values()]
        assert counts[0] == counts[1] <= len(loaded.plan)

    def test_frames_show_their_patterns(self, ready: RigDevices) -> None:
        """White is brighter than black, in a sequence and held."""
        everything = showable(ready.projector.info, ready.projector.info.limits.patterns)
        if not self.sees_light or not {"white", "black"} <= set(everything.names):
            pytest.skip("the cameras see no light, or there is no white and black to tell apart")
        plan = everything.restricted_to(("white", "black"))
        loaded = ready.projector.load(plan, self._period_us(ready, plan))
        frames = self._sequence(ready, loaded)
        for side, camera in ready.cameras.items():
            camera.disarm()
            means = dict(zip(plan.names, (float(np.mean(f.image)) for f in frames[side]), strict=True))
            assert means["white"] > means["black"]
        for camera in ready.cameras.values():
            held = {}
            for pattern in plan.patterns:
                ready.projector.show(pattern)
                camera.arm(None, Trigger.FREE_RUN)
                held[pattern.name] = float(np.mean(camera.wait_frame(self.patience_s).image))
                camera.disarm()
            assert held["white"] > held["black"]

    def _period_us(self, rig: RigDevices, plan: PatternPlan) -> float:
        """Shortest period in which the patterns have their exposures and the cameras are ready again."""
        periods = [pattern.exposure_us or 0.0 for pattern in plan.patterns]
        for camera in rig.cameras.values():
            assert isinstance(camera, EdgeTriggered)
            periods.append(1.01 * camera.min_period_us(as_asked(camera.read_settings())))
        return max(periods)

    def _load(self, rig: RigDevices, count: int) -> LoadedSequence:
        plan = showable(rig.projector.info, count)
        return rig.projector.load(plan, self._period_us(rig, plan))

    def _arm(self, rig: RigDevices, loaded: LoadedSequence) -> None:
        for camera in rig.cameras.values():
            camera.arm(len(loaded.plan), Trigger.HARDWARE_EDGE)

    def _collect(self, camera: Camera, loaded: LoadedSequence) -> list[Frame]:
        return [camera.wait_frame(self.patience_s) for _ in loaded.plan.patterns]

    def _sequence(self, rig: RigDevices, loaded: LoadedSequence) -> dict[Side, list[Frame]]:
        """One whole sequence; the cameras stay armed."""
        self._arm(rig, loaded)
        rig.projector.start()
        frames = {side: self._collect(rig.cameras[side], loaded) for side in SIDES}
        assert wait_until(lambda: rig.projector.state == ProjectorState.LOADED, self.patience_s)
        return frames

    @staticmethod
    def _check_times(frames: list[Frame], loaded: LoadedSequence) -> None:
        exposed_ns = np.array([frame.device_ns for frame in frames])
        planned_ns = 1000 * np.array(loaded.pulses_us)
        allowed_ns = np.maximum(_INTERVAL_SHARE * np.diff(planned_ns), _INTERVAL_LEAST_NS)
        assert (np.abs(np.diff(exposed_ns) - np.diff(planned_ns)) <= allowed_ns).all()
