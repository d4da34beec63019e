"""The three devices of one rig, as a driver hands them out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.camera import Camera
from drivers.projector import Projector
from drivers.stage import Stage
from models.geometry.rig import Rig, Side


@dataclass(frozen=True, eq=False)
class RigDevices:
    """Devices that belong together, not yet opened.

    calibration: the rig's calibration in force, None where the stage knows a better one or there is none.
    stage: what stands before devices that are not hardware. warnings: what every user of the rig must know. release:
    lets go of what the devices stand on, once they are closed for good.
    """

    left: Camera
    right: Camera
    projector: Projector
    calibration: Rig | None = None
    stage: Stage | None = None
    warnings: tuple[str, ...] = ()
    release: Callable[[], None] = lambda: None

    @property
    def cameras(self) -> dict[Side, Camera]:
        return {"left": self.left, "right": self.right}

    @property
    def calibration_in_force(self) -> Rig | None:
        """The configured calibration, else the stage's own."""
        if self.calibration is not None:
            return self.calibration
        return None if self.stage is None else self.stage.calibration
