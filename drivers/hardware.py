"""The rig that stands on a bench: two cameras and a LightCrafter 4500."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import usb.core
from pydantic import BaseModel, ConfigDict

from drivers import aravis, spinnaker
from drivers.camera import Camera
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DeviceNotFoundError, DeviceUnavailableError
from drivers.genicam import FoundCamera, GenicamConfiguration
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import PRODUCT, VENDOR
from models.geometry.rig import Rig, Side

NAME = "rig"
CameraDriverName = Literal["aravis", "spinnaker"]


class CameraDriver(NamedTuple):
    """camera: makes one, not yet opened, for a role in the rig. find: which ones answer.

    Both may raise DeviceUnavailableError where the driver's library is not installed.
    """

    camera: Callable[[str, GenicamConfiguration], Camera]
    find: Callable[[GenicamConfiguration], Sequence[FoundCamera]]


_CAMERA_DRIVERS: Mapping[CameraDriverName, CameraDriver] = {
    "aravis": CameraDriver(aravis.AravisCamera, lambda camera: aravis.find_cameras(camera.library)),
    "spinnaker": CameraDriver(spinnaker.SpinnakerCamera, lambda _: spinnaker.find_cameras()),
}


class CamerasConfiguration(BaseModel):
    """Both cameras. driver: what they are reached through."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    driver: CameraDriverName = "aravis"
    left: GenicamConfiguration = GenicamConfiguration()
    right: GenicamConfiguration = GenicamConfiguration()

    def find(self) -> Sequence[FoundCamera]:
        """Every camera that answers the driver; DeviceUnavailableError without its library."""
        return _CAMERA_DRIVERS[self.driver].find(self.left)

    @property
    def named(self) -> bool:
        """Whether each camera is told from the other."""
        return all(camera.serial is not None or camera.address is not None for camera in (self.left, self.right))


def make_camera(side: Side, cameras: CamerasConfiguration) -> Camera:
    """One camera through its driver, not yet opened."""
    return _CAMERA_DRIVERS[cameras.driver].camera(f"{side} camera", getattr(cameras, side))


def hardware_rig(
    cameras: CamerasConfiguration, projector: LightCrafterConfiguration, calibration: Rig | None = None
) -> RigDevices:
    """The devices, not yet opened.

    Raises DeviceConfigurationError where the cameras are not told apart, and for a missing or damaged manifest of the
    projector.
    """
    from drivers.lightcrafter.connect import make_projector

    if not cameras.named:
        raise DeviceConfigurationError(
            NAME,
            "cameras",
            "without names",
            f"two must be told apart; set rig.cameras.left.serial and rig.cameras.right.serial ({_there(cameras)})",
        )
    left, right = (make_camera(side, cameras) for side in ("left", "right"))
    return RigDevices(left, right, make_projector(projector), calibration)


def require_attached(cameras: CamerasConfiguration, projector: LightCrafterConfiguration) -> None:
    """Raises DeviceNotFoundError where neither a camera nor the projector is to be seen.

    Whatever is attached counts: a rig of which one part is missing is an error for its user to see, not a reason to
    take another rig.
    """
    if projector.connection == "usb" and not _projector_is_on_usb():
        missing = [f"no projector at USB {VENDOR:04x}:{PRODUCT:04x}"]
        try:
            if cameras.find():
                return
            missing.append("no camera")
        except DeviceUnavailableError as error:
            missing.append(str(error))
        raise DeviceNotFoundError(NAME, " and ".join(missing))


def _projector_is_on_usb() -> bool:
    try:
        return usb.core.find(idVendor=VENDOR, idProduct=PRODUCT) is not None
    except usb.core.NoBackendError:
        return False


def _there(cameras: CamerasConfiguration) -> str:
    try:
        found = cameras.find()
    except DeviceUnavailableError as error:
        return str(error)
    return "there are: " + (", ".join(f"{camera.model} {camera.serial}" for camera in found) or "none")
