"""An orchestrator on a virtual bench."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.bench import VirtualBench
from drivers.camera import CameraState
from drivers.devices import RigDevices
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.projector import ProjectorState
from service.acquisition.orchestrator import Orchestrator

IMPATIENT = LightCrafterConfiguration(timeout_s=0.4, settle_s=0.5, validate_first_s=0.02, validate_s=2.0, wake_s=0.3)
"""For a bench whose images are small."""


@dataclass(frozen=True, eq=False)
class Bench:
    """An orchestrator with the bench below its devices, and another that tries nothing twice."""

    virtual: VirtualBench
    devices: RigDevices
    orchestrator: Orchestrator
    strict: Orchestrator

    @property
    def is_safe(self) -> bool:
        """Cameras disarmed, projector stopped and dark, lock free."""
        armed = any(camera.state is CameraState.ARMED for camera in self.devices.cameras.values())
        projector = self.virtual.projector
        lit = self.devices.projector.state in (ProjectorState.PROJECTING, ProjectorState.HOLDING)
        dark = not projector.running and not projector.light().any()
        return not armed and not lit and dark and self.orchestrator.holder is None and self.strict.holder is None
