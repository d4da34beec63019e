"""A virtual rig put together."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.devices import RigDevices
from drivers.virtual.bench import Bench
from drivers.virtual.camera import VirtualCamera
from drivers.virtual.clock import BenchTime
from drivers.virtual.faults import Faults, PlantedFault
from drivers.virtual.projector import VirtualProjector
from drivers.virtual.source import SceneSource
from models.geometry.rig import Rig


def virtual_rig(
    source: SceneSource,
    *,
    faults: Iterable[PlantedFault] = (),
    realtime: bool = True,
    calibration: Rig | None = None,
    warnings: Iterable[str] = (),
) -> RigDevices:
    """Two cameras and a projector before a scene source.

    realtime: pulses and frames come when they would on a real rig; else at once. calibration: in force instead of the
    source's own.
    """
    bench = Bench(source, Faults(faults), BenchTime(realtime=realtime))
    left, right = VirtualCamera("left", bench), VirtualCamera("right", bench)
    return RigDevices(left, right, VirtualProjector(bench), calibration, source, tuple(warnings))


def bench_of(devices: RigDevices) -> Bench:
    """What lies between virtual devices; TypeError for other devices."""
    if not isinstance(devices.projector, VirtualProjector):
        raise TypeError("only virtual devices stand on a bench")
    return devices.projector.bench
