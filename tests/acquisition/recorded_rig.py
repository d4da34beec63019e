"""A rig that replays one simulated capture without waiting, on which faults can be planted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from drivers.camera import CameraState
from drivers.devices import RigDevices
from drivers.projector import ProjectorState
from drivers.replay.source import ReplaySource
from drivers.virtual.bench import Bench
from drivers.virtual.faults import PlantedFault
from drivers.virtual.rig import bench_of, virtual_rig
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.settings import AcquisitionSettings


@dataclass(frozen=True, eq=False)
class RecordedRig:
    """An orchestrator with the bench behind its devices."""

    orchestrator: Orchestrator
    devices: RigDevices
    bench: Bench

    @property
    def is_safe(self) -> bool:
        """Cameras disarmed, projector neither projecting nor holding, lock free."""
        armed = any(camera.state is CameraState.ARMED for camera in self.devices.cameras.values())
        lit = self.devices.projector.state in (ProjectorState.PROJECTING, ProjectorState.HOLDING)
        return not armed and not lit and self.bench.shown is None and self.orchestrator.holder is None


def recorded_rig(folder: Path, faults: Iterable[PlantedFault] = (), *, retakes: int = 2) -> RecordedRig:
    """Connected, before the captures in ``folder``."""
    devices = virtual_rig(ReplaySource(folder), faults=faults, realtime=False)
    orchestrator = Orchestrator(devices, AcquisitionSettings(retakes=retakes))
    orchestrator.connect()
    return RecordedRig(orchestrator, devices, bench_of(devices))
