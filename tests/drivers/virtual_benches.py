"""Virtual devices on the benches of the contract tests."""

from __future__ import annotations

from drivers.devices import RigDevices
from drivers.testing import CameraBench, ProjectorBench
from drivers.virtual.camera import VirtualCamera
from drivers.virtual.projector import VirtualProjector
from drivers.virtual.rig import bench_of


def camera_bench(devices: RigDevices) -> CameraBench:
    """The left camera of a virtual rig."""
    camera, bench = devices.left, bench_of(devices)
    assert isinstance(camera, VirtualCamera)
    return CameraBench(camera, lambda: bench.send_stray_pulse("left"), camera.unplug, camera.plug)


def projector_bench(devices: RigDevices) -> ProjectorBench:
    """The projector of a virtual rig."""
    projector, bench = devices.projector, bench_of(devices)
    assert isinstance(projector, VirtualProjector)
    return ProjectorBench(projector, lambda: bench.pulses_sent, projector.unplug, projector.plug)


def both_benches(devices: RigDevices) -> tuple[CameraBench, ProjectorBench]:
    """The left camera and the projector of one virtual rig."""
    return camera_bench(devices), projector_bench(devices)
