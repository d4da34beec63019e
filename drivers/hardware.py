"""The rig that stands on a bench: two cameras and a LightCrafter 4500."""

from __future__ import annotations

from typing import Literal

import usb.core
from pydantic import BaseModel, ConfigDict

from drivers.aravis.discovery import find_cameras
from drivers.camera import Camera
from drivers.devices import RigDevices
from drivers.errors import DeviceNotFoundError, DeviceUnavailableError
from drivers.genicam.configuration import GenicamConfiguration
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import PRODUCT, VENDOR
from models.geometry.rig import Rig, Side

NAME = "rig"


class CamerasConfiguration(BaseModel):
    """Both cameras. driver: what they are reached through."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    driver: Literal["aravis"] = "aravis"
    left: GenicamConfiguration = GenicamConfiguration()
    right: GenicamConfiguration = GenicamConfiguration()

    @property
    def named(self) -> bool:
        """Whether each camera is told from the other."""
        return all(camera.serial is not None or camera.address is not None for camera in (self.left, self.right))


def hardware_rig(
    cameras: CamerasConfiguration, projector: LightCrafterConfiguration, calibration: Rig | None = None
) -> RigDevices:
    """The devices, not yet opened.

    Raises DeviceNotFoundError where the cameras are not told apart, DeviceConfigurationError for a missing or damaged
    manifest of the projector.
    """
    from drivers.lightcrafter.connect import make_projector

    if not cameras.named:
        raise DeviceNotFoundError(
            NAME,
            f"two cameras must be told apart; set rig.cameras.left.serial and rig.cameras.right.serial ({_there()})",
        )
    left, right = (_camera(side, cameras) for side in ("left", "right"))
    return RigDevices(left, right, make_projector(projector), calibration)


def require_attached(cameras: CamerasConfiguration, projector: LightCrafterConfiguration) -> None:
    """Raises DeviceNotFoundError where neither a camera nor the projector is to be seen.

    Whatever is attached counts: a rig of which one part is missing is an error for its user to see, not a reason to
    take another rig.
    """
    if projector.connection == "usb" and not _projector_is_on_usb():
        missing = [f"no projector at USB {VENDOR:04x}:{PRODUCT:04x}"]
        try:
            if find_cameras(cameras.left.library):
                return
            missing.append("no camera")
        except DeviceUnavailableError as error:
            missing.append(str(error))
        raise DeviceNotFoundError(NAME, " and ".join(missing))


def _camera(side: Side, configuration: CamerasConfiguration) -> Camera:
    from drivers.aravis.camera import AravisCamera

    return AravisCamera(f"{side} camera", getattr(configuration, side))


def _projector_is_on_usb() -> bool:
    try:
        return usb.core.find(idVendor=VENDOR, idProduct=PRODUCT) is not None
    except usb.core.NoBackendError:
        return False


def _there() -> str:
    try:
        found = find_cameras()
    except DeviceUnavailableError as error:
        return str(error)
    return "there are: " + (", ".join(f"{camera.model} {camera.serial}" for camera in found) or "none")
