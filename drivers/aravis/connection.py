"""A camera that is held open."""

from __future__ import annotations

import threading

from drivers.aravis.discovery import is_loopback, locate, privilege
from drivers.aravis.features import AravisFeatures
from drivers.aravis.library import ACCESS_CHECK, RANGE_CHECK, USB_MODES, AravisError, ControlLost, Library, load_library
from drivers.aravis.stream import AravisStream, stop
from drivers.errors import (
    DeviceBusyError,
    DeviceNotFoundError,
    DevicePermissionError,
    DriverError,
)
from drivers.genicam.configuration import GenicamConfiguration
from drivers.genicam.connection import FrameIds
from drivers.genicam.finding import same_serial

_PERMISSION = ("permission", "access denied", "libusb_error_access", "insufficient")
_BUSY = ("busy", "claim", "in use", "not-controller", "not controller")
_RELEASE_S = 15.0
"""The library asks a silent camera several times, half a second each, before it gives up."""


class AravisConnection:
    """Opened by its making, which raises what ``Camera.open`` may; held until ``release``."""

    def __init__(self, device: str, configuration: GenicamConfiguration) -> None:
        self.library: Library = load_library(device, configuration.library)
        address = None if configuration.address is None else str(configuration.address)
        found = locate(self.library, device, configuration.serial, address)
        try:
            self.handle: int = self.library.call("camera_new", found.id.encode())
        except AravisError as error:
            raise _why(device, str(error)) from error
        self._device_handle: int = self.library.call("camera_get_device", self.handle)
        self.gige = bool(self.library.call("camera_is_gv_device", self.handle))
        self.address = found.address
        self.simulated = self.gige and is_loopback(found.address)
        self._control_lost = threading.Event()
        self._callback = ControlLost(lambda *_: self._control_lost.set())
        self._handler = self.library.on_control_lost(self._device_handle, self._callback)
        self.features = AravisFeatures(self.library, self.handle, device)
        try:
            self._check(device, configuration)
            stop(self.library, self.handle)  # whoever had it last may have left it running
        except DriverError:
            self.release()
            raise

    def is_alive(self) -> bool:
        if self._control_lost.is_set():
            return False
        if self.gige:
            return bool(privilege(self.address))
        try:
            self.features.read("Width", int)
        except DriverError:
            return False
        return True

    @property
    def control_lost(self) -> bool:
        return self._control_lost.is_set()

    def make_stream(self, frames: int | None, ids: FrameIds) -> AravisStream:
        return AravisStream(self.library, self.handle, frames, ids, gige=self.gige)

    def release(self, *, dead: bool = False) -> None:
        self.library.disconnect(self._device_handle, self._handler)
        (self.library.release_later if dead else self.library.release)(self.handle)

    def _check(self, device: str, configuration: GenicamConfiguration) -> None:
        if self.gige and not self.library.call("gv_device_is_controller", self._device_handle):
            raise DeviceBusyError(device, "another program controls the camera; end that one first")
        wanted, shown = configuration.serial, self.features.serial
        if wanted is not None and not same_serial(wanted, shown):
            raise DeviceNotFoundError(
                device, f"the camera at {self.address} has the serial number {shown}, not {wanted}"
            )
        self.library.call("camera_set_range_check_policy", self.handle, RANGE_CHECK)
        self.library.call("camera_set_access_check_policy", self.handle, ACCESS_CHECK)
        if configuration.usb_mode is not None and self.library.call("camera_is_uv_device", self.handle):
            self.library.call("camera_uv_set_usb_mode", self.handle, USB_MODES[configuration.usb_mode])


def connect(device: str, configuration: GenicamConfiguration) -> AravisConnection:
    """A new connection; it waits where the camera is still held by one of ours that has died."""
    try:
        return AravisConnection(device, configuration)
    except DeviceBusyError:
        if not load_library(device, configuration.library).await_releases(_RELEASE_S):
            raise
        return AravisConnection(device, configuration)


def _why(device: str, text: str) -> DriverError:
    lowered = text.lower()
    if any(word in lowered for word in _PERMISSION):
        return DevicePermissionError(
            device, f"the system refuses access ({text}); install the udev rule for the camera"
        )
    if any(word in lowered for word in _BUSY):
        return DeviceBusyError(device, f"another program holds the camera ({text}); end that one first")
    return DeviceNotFoundError(device, f"the camera cannot be opened ({text}); check its cable and power")
