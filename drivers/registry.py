"""Which driver stands for which name. A driver is one function and one line of a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.devices import RigDevices
from drivers.errors import DeviceNotFoundError, DeviceUnavailableError
from drivers.hardware import CamerasConfiguration, hardware_rig, require_attached
from drivers.lightcrafter.settings import LightCrafterConfiguration
from models.geometry.rig import Rig

DriverName = Literal["simulated", "replay", "hardware", "bench", "auto"]
NAME = "rig"


class SimulatedConfiguration(BaseModel):
    """seed, scene: of the series of scenes that the simulated rig stands before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(0, ge=0)
    scene: int = Field(0, ge=0, le=999_999)


class RigConfiguration(BaseModel):
    """Which rig to make.

    driver: "auto" takes the hardware that is attached, else replays, if a folder is named. "bench" is hardware that
    programs stand in for. replay: folder of captures. calibration: file that goes before what the devices know of their
    calibration. realtime: whether simulated and replayed devices take their time. cameras, projector: the hardware.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    driver: DriverName = "auto"
    replay: Path | None = None
    calibration: Path | None = None
    simulated: SimulatedConfiguration = SimulatedConfiguration()
    realtime: bool = True
    cameras: CamerasConfiguration = CamerasConfiguration()
    projector: LightCrafterConfiguration = LightCrafterConfiguration()

    def read_calibration(self) -> Rig | None:
        """The rig of ``calibration``; CalibrationError where the file is unreadable."""
        return None if self.calibration is None else Rig.from_file(self.calibration)


Factory = Callable[[RigConfiguration], RigDevices]


def make_devices(configuration: RigConfiguration) -> RigDevices:
    """The devices of a rig, not yet opened.

    Raises DeviceNotFoundError where there is none, DeviceUnavailableError where a driver's library lacks, and
    CalibrationError for an unreadable calibration.
    """
    return _DRIVERS[configuration.driver](configuration)


def _simulated(configuration: RigConfiguration) -> RigDevices:
    from drivers.simulator.devices import SimulatedSource
    from drivers.virtual.rig import virtual_rig

    calibration = configuration.read_calibration()
    source = SimulatedSource(configuration.simulated.seed, configuration.simulated.scene)
    return virtual_rig(source, realtime=configuration.realtime, calibration=calibration)


def _replay(configuration: RigConfiguration, *warnings: str) -> RigDevices:
    from drivers.replay.source import ReplaySource
    from drivers.virtual.rig import virtual_rig

    if configuration.replay is None:
        raise DeviceNotFoundError(NAME, "the driver 'replay' needs a folder of captures; name one")
    calibration = configuration.read_calibration()
    source = ReplaySource(configuration.replay)
    warnings = (*warnings, *source.warnings)
    return virtual_rig(source, realtime=configuration.realtime, calibration=calibration, warnings=warnings)


def _auto(configuration: RigConfiguration) -> RigDevices:
    """Hardware that is there but cannot be used is an error: replaying instead would hide it."""
    reasons = []
    for name, find in HARDWARE.items():
        try:
            return find(configuration)
        except (DeviceNotFoundError, DeviceUnavailableError) as error:
            reasons.append(f"{name}: {error}")
    why = "; ".join(reasons) or "no driver of hardware is installed"
    if configuration.replay is None:
        raise DeviceNotFoundError(
            NAME, f"no hardware was found ({why}); attach it, name a folder to replay, or take the driver 'simulated'"
        )
    warning = f"no hardware was found ({why}); replaying recorded captures from {configuration.replay}"
    return _replay(configuration, warning)


def _hardware(configuration: RigConfiguration) -> RigDevices:
    return hardware_rig(configuration.cameras, configuration.projector, configuration.read_calibration())


def _attached(configuration: RigConfiguration) -> RigDevices:
    require_attached(configuration.cameras, configuration.projector)
    return _hardware(configuration)


def _bench(configuration: RigConfiguration) -> RigDevices:
    from drivers.bench.devices import bench_rig

    simulated = configuration.simulated
    return bench_rig(simulated.seed, simulated.scene, configuration.read_calibration())


HARDWARE: dict[str, Factory] = {"cameras and LightCrafter 4500": _attached}
"""What "auto" looks for, in this order. A finder raises DeviceNotFoundError where its hardware is not attached and
DeviceUnavailableError where its library is not installed."""
_DRIVERS: Mapping[DriverName, Factory] = {
    "simulated": _simulated,
    "replay": _replay,
    "hardware": _hardware,
    "bench": _bench,
    "auto": _auto,
}
