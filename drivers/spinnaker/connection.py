"""A camera that is held open, and which ones there are."""

from __future__ import annotations

import ipaddress
from contextlib import suppress
from typing import Any

from drivers.errors import (
    DeviceBusyError,
    DeviceConfigurationError,
    DeviceNotFoundError,
    DeviceUnavailableError,
    DriverError,
)
from drivers.genicam.configuration import GenicamConfiguration
from drivers.genicam.connection import FrameIds
from drivers.genicam.finding import FoundCamera, pick_camera
from drivers.spinnaker.features import SpinnakerFeatures
from drivers.spinnaker.library import (
    ACCESS_DENIED,
    BUSY,
    RESOURCE_IN_USE,
    CameraHandle,
    Spinnaker,
    SpinnakerError,
    load_spinnaker,
)
from drivers.spinnaker.stream import SpinnakerStream


class SpinnakerConnection:
    """Opened by its making, which raises what ``Camera.open`` may; held until ``release``."""

    simulated = False
    control_lost = False  # Spinnaker tells so only when asked

    def __init__(self, device: str, configuration: GenicamConfiguration) -> None:
        self._device = device
        self._spinnaker = _started(device)
        self._handle = CameraHandle(self._spinnaker, None)
        self._id = ""
        try:
            self._open(configuration)
        except SpinnakerError as error:
            self.release()
            raise _why(device, error) from error
        except DriverError:
            self.release()
            raise

    def is_alive(self) -> bool:
        try:
            self.features.read("Width", int)
        except DriverError:
            return False
        return True

    def make_stream(self, frames: int | None, ids: FrameIds) -> SpinnakerStream:
        settings = SpinnakerFeatures(self._spinnaker, self._handle.call("GetTLStreamNodeMap"), self._device)
        return SpinnakerStream(self._handle, settings, self._device, frames, ids)

    def release(self, *, dead: bool = False) -> None:
        del dead  # a camera that is gone must be let go in the same order
        with suppress(SpinnakerError):
            self._handle.call("DeInit")
        self._handle.drop()
        self._spinnaker.disclaim(self._id)
        self._spinnaker.release()

    def _open(self, configuration: GenicamConfiguration) -> None:
        with self._spinnaker.cameras() as cameras:
            found = _described(self._spinnaker, cameras, self._device)
            camera = _chosen(found, self._device, configuration)
            if not self._spinnaker.claim(camera.id):
                raise DeviceBusyError(self._device, f"the camera {camera.serial} is open already in this program")
            self._id = camera.id
            index = found.index(camera)
            self._handle = CameraHandle(self._spinnaker, self._spinnaker.call(cameras.GetByIndex, index))
        self._handle.call("Init")
        self.gige = camera.protocol == "GigEVision"
        self.features = SpinnakerFeatures(self._spinnaker, self._handle.call("GetNodeMap"), self._device)
        with suppress(DeviceConfigurationError):
            self.features.execute("AcquisitionStop")  # whoever had it last may have left it running


def find_cameras(device: str = "camera") -> list[FoundCamera]:
    """Every camera that answers. Raises DeviceUnavailableError without PySpin."""
    spinnaker = _started(device)
    try:
        with spinnaker.cameras() as cameras:
            return _described(spinnaker, cameras, device)
    except SpinnakerError as error:
        raise _why(device, error) from error
    finally:
        spinnaker.release()


def _started(device: str) -> Spinnaker:
    spinnaker = load_spinnaker(device)
    try:
        spinnaker.acquire()
    except SpinnakerError as error:
        raise DeviceUnavailableError(
            device, f"Spinnaker does not start ({error}); check the installation of its SDK"
        ) from error
    return spinnaker


def _described(spinnaker: Spinnaker, cameras: Any, device: str) -> list[FoundCamera]:
    """In the order of the list; no pointer to a camera is left anywhere."""

    def nodes_of(index: int) -> Any:
        return cameras.GetByIndex(index).GetTLDeviceNodeMap()

    return [
        _description(SpinnakerFeatures(spinnaker, spinnaker.call(nodes_of, index), device))
        for index in range(spinnaker.call(cameras.GetSize))
    ]


def _description(features: SpinnakerFeatures) -> FoundCamera:
    serial = features.first_text("DeviceSerialNumber")
    if features.has("GevDeviceIPAddress"):
        address = str(ipaddress.IPv4Address(features.read("GevDeviceIPAddress", int)))
    else:
        address = features.first_text("DeviceLocation")
    protocol = features.first_text("DeviceType")
    return FoundCamera(
        features.first_text("DeviceID") or serial, features.first_text("DeviceModelName"), serial, address, protocol
    )


def _chosen(found: list[FoundCamera], device: str, configuration: GenicamConfiguration) -> FoundCamera:
    if configuration.address is not None:
        address = str(configuration.address)
        found = [camera for camera in found if camera.address == address]
        if not found:
            raise DeviceNotFoundError(device, f"no camera answers at {address}; check its cable, power and address")
    return pick_camera(found, device, configuration.serial)


def _why(device: str, error: SpinnakerError) -> DriverError:
    if error.code in (RESOURCE_IN_USE, BUSY):
        return DeviceBusyError(device, f"another program holds the camera ({error}); end that one first")
    if error.code == ACCESS_DENIED:
        return DeviceBusyError(
            device,
            f"access is denied ({error}); end the program that holds the camera, or install the SDK's udev rules",
        )
    return DeviceNotFoundError(device, f"the camera cannot be opened ({error}); check its cable and power")
