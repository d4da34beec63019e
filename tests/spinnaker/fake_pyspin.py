"""A stand-in for FLIR's PySpin: written for these tests, knows no hardware, and proves nothing about the real one.

It keeps the rules that the driver relies on: numbers of errors, features that lock one another, a system that cannot
be released while anything of it is held, images that must be given back once, values that are read from a cache.
"""

from __future__ import annotations

import ipaddress
import threading
import time
import weakref
from typing import Any

import numpy as np
from fake_pyspin_nodes import (
    IN_USE,
    IO,
    NULL,
    TIMEOUT,
    FakeEntry,
    FakeNode,
    FakeNodes,
    SpinnakerException,
)

from drivers.gigevision.features import FEATURES, Condition, Feature
from drivers.gigevision.pictures import numbered_ramp
from drivers.gigevision.sensor import Exposure, Sensor
from models.capture import Image

_GARBAGE = 0xA5
_STREAM_FEATURES = (
    Feature("StreamBufferHandlingMode", "enumeration", 1, entries=("OldestFirst", "NewestOnly")),
    Feature("StreamBufferCountMode", "enumeration", 1, entries=("Manual", "Auto")),
    Feature("StreamBufferCountManual", "integer", 10, 1, 500, locked=(Condition("StreamBufferCountMode", 1),)),
)


class FakeImage:
    """A buffer of the library's. Release: how often it was given back shows in ``releases``."""

    def __init__(self, exposure: Exposure, frame_id: int, pixels: Image, name: str, status: int) -> None:
        self.exposure, self.frame_id, self.name, self.status = exposure, frame_id, name, status
        self._pixels = pixels
        self.releases = 0
        self.unreadable = False

    def GetFrameID(self) -> int:  # noqa: N802
        return self._alive().frame_id

    def GetTimeStamp(self) -> int:  # noqa: N802
        return round(self._alive().exposure.start_s * 1e9)

    def IsIncomplete(self) -> bool:  # noqa: N802
        return self._alive().status != 0

    def GetImageStatus(self) -> int:  # noqa: N802
        return self._alive().status

    def GetPixelFormatName(self) -> str:  # noqa: N802
        return self._alive().name

    def GetNDArray(self) -> Image:  # noqa: N802
        if self.status or self.unreadable:
            raise SpinnakerException(IO, "Image is incomplete")
        return self._alive()._pixels

    def Release(self) -> None:  # noqa: N802
        self.releases += 1
        self._pixels.fill(_GARBAGE)  # the library writes the next frame into it

    def _alive(self) -> FakeImage:
        if self.releases:
            raise SpinnakerException(NULL, "Image was released")
        return self


class FakeImagePointer:
    """An ImagePtr: all of the image, and one more thing that must not be kept."""

    def __init__(self, image: FakeImage) -> None:
        self._image = image

    def __getattr__(self, name: str) -> Any:
        return getattr(self._image, name)


class FakeDevice:
    """A camera on its cable, with the hands that a test reaches behind the driver with.

    incomplete: status of the image of a pulse. unreadable: pulses whose images cannot be read. dropped: pulses whose
    frames never come. init_error, begin_error: number of the error that Init or BeginAcquisition meets with.
    removal_error: of GetNextImage without a camera.
    """

    def __init__(self, serial: str, address: str | None = None) -> None:
        self.serial, self.address = serial, address
        self.plugged = True
        self.lock = threading.RLock()
        self.incomplete: dict[int, int] = {}
        self.dropped: set[int] = set()
        self.unreadable: set[int] = set()
        self.init_error = self.begin_error = 0
        self.removal_error = IO
        self.mistakes: list[str] = []
        self.images: list[FakeImage] = []
        self.switch_on()

    def switch_on(self) -> None:
        """Everything as the factory left it."""
        model = {"DeviceVendorName": "Point Grey Research", "DeviceModelName": "Grasshopper3 GS3-U3-23S6M"}
        texts = {**model, "DeviceSerialNumber": self.serial, "DeviceID": f"FLIR-{self.serial}"}
        self.nodes = FakeNodes(FEATURES, {**texts, "DeviceFirmwareVersion": "2.23.3.0"})
        self.nodes.device = self
        self.tl_nodes = FakeNodes((), {**texts, "DeviceType": "USB3Vision", "DeviceLocation": "2-1"})
        if self.address is not None:
            number = int(ipaddress.IPv4Address(self.address))
            self.tl_nodes = FakeNodes(
                (Feature("GevDeviceIPAddress", "integer", number),), {**texts, "DeviceType": "GigEVision"}
            )
        self.stream_nodes = FakeNodes(_STREAM_FEATURES)
        self.sensor = Sensor()
        self.queue: list[FakeImage] = []
        self.acquiring = self.initialised = False
        self.free_s = 0.0

    def unplug(self) -> None:
        with self.lock:
            self.plugged = self.nodes.reachable = self.tl_nodes.reachable = False

    def plug(self) -> None:
        with self.lock:
            self.switch_on()
            self.plugged = True

    def pulse(self, line: str = "Line3", edge: str = "RisingEdge") -> None:
        """One edge on a line."""
        if self.nodes.entry("TriggerActivation") == edge:
            self.trigger(line)

    def trigger(self, source: str) -> None:
        with self.lock:
            nodes = self.nodes
            listening = self.acquiring and self.plugged and nodes.entry("TriggerMode") == "On"
            if listening and nodes.entry("TriggerSource") == source:
                self.sensor.pulses += 1
                self.expose(time.monotonic(), overlap=nodes.entry("TriggerOverlap") == "ReadOut")

    def expose(self, now_s: float, *, overlap: bool) -> None:
        values = self.nodes.values
        exposed = self.sensor.expose(
            now_s, values["ExposureTime"], values["Gain"], int(values["Height"]), overlap=overlap
        )
        if exposed is None or exposed.index in self.dropped:
            return
        size = (int(values["Width"]), int(values["Height"]))
        pixels = numbered_ramp(exposed.index, exposed.exposure_us, exposed.gain_db, size)
        name = self.nodes.entry("PixelFormat")
        if name == "Mono16":
            pixels = pixels.astype(np.uint16) << 8
        frame_id = exposed.block - (self.address is None)
        image = FakeImage(exposed, frame_id, np.array(pixels), name, self.incomplete.get(exposed.index, 0))
        image.unreadable = exposed.index in self.unreadable
        if self.stream_nodes.entry("StreamBufferHandlingMode") == "NewestOnly":
            self._give_back(self.queue)
            self.queue = []
        if len(self.queue) < self.stream_nodes.values["StreamBufferCountManual"]:
            self.queue.append(image)

    def begin(self) -> None:
        with self.lock:
            self.sensor.start()
            self.queue = []
            self.acquiring, self.free_s = True, time.monotonic()
            self.nodes.values["TLParamsLocked"] = 1

    def end(self) -> None:
        with self.lock:
            self._give_back(self.queue)
            self.queue = []
            self.acquiring = False
            self.nodes.values["TLParamsLocked"] = 0

    def next_image(self, timeout_ms: int) -> FakeImage:
        deadline = time.monotonic() + 1e-3 * timeout_ms
        while True:
            with self.lock:
                now = time.monotonic()
                self._run_freely(now)
                if self.queue and self.queue[0].exposure.read_s <= now:
                    self.images.append(self.queue.pop(0))
                    return self.images[-1]
                if not self.plugged and (self.removal_error != TIMEOUT or now >= deadline):
                    raise SpinnakerException(self.removal_error, "Failed waiting for EventData")
            if now >= deadline:
                raise SpinnakerException(TIMEOUT, "Failed waiting for EventData on NEW_BUFFER_DATA event")
            time.sleep(min(0.001, deadline - now))

    def execute(self, name: str) -> None:
        if name == "TriggerSoftware":
            self.trigger("Software")

    def waits_for_trigger(self) -> bool:
        nodes = self.nodes
        triggered = self.acquiring and nodes.entry("TriggerMode") == "On"
        asked = nodes.entry("AcquisitionStatusSelector") == "FrameTriggerWait"
        overlap = nodes.entry("TriggerOverlap") == "ReadOut"
        return triggered and asked and self.sensor.takes(time.monotonic(), overlap=overlap)

    def _run_freely(self, now: float) -> None:
        values = self.nodes.values
        while self.acquiring and self.plugged and not values["TriggerMode"] and self.free_s <= now:
            self.sensor.pulses += 1
            self.expose(self.free_s, overlap=True)
            self.free_s += 1 / values["AcquisitionFrameRate"]

    def _give_back(self, images: list[FakeImage]) -> None:
        for image in images:
            image.Release()


class FakeCamera:
    """A CameraPtr. A device that went and came back is another one to it."""

    def __init__(self, device: FakeDevice, pointers: weakref.WeakSet[Any]) -> None:
        self._device, self._nodes, self._pointers = device, device.nodes, pointers
        pointers.add(self)

    def Init(self) -> None:  # noqa: N802
        if self._device.init_error:
            raise SpinnakerException(self._device.init_error, "Could not open the device")
        self._there().initialised = True

    def DeInit(self) -> None:  # noqa: N802
        device = self._device
        if device.nodes is self._nodes:
            if device.acquiring:
                device.mistakes.append("DeInit while acquiring")
            device.initialised = False
        self._there()

    def GetNodeMap(self) -> FakeNodes:  # noqa: N802
        if not self._there().initialised:
            raise SpinnakerException(-1002, "Camera is not initialized")
        return self._nodes

    def GetTLDeviceNodeMap(self) -> FakeNodes:  # noqa: N802
        return self._device.tl_nodes

    def GetTLStreamNodeMap(self) -> FakeNodes:  # noqa: N802
        return self._there().stream_nodes

    def BeginAcquisition(self) -> None:  # noqa: N802
        if self._device.begin_error:
            raise SpinnakerException(self._device.begin_error, "Could not start acquisition")
        self._there().begin()

    def EndAcquisition(self) -> None:  # noqa: N802
        if self._device.nodes is self._nodes and self._device.acquiring:
            self._device.end()
            return
        raise SpinnakerException(-1002, "Camera is not started")

    def GetNextImage(self, timeout_ms: int) -> FakeImagePointer:  # noqa: N802
        if self._device.nodes is not self._nodes or not self._device.acquiring:
            raise SpinnakerException(IO, "Camera is not streaming")
        image = FakeImagePointer(self._device.next_image(timeout_ms))
        self._pointers.add(image)
        return image

    def _there(self) -> FakeDevice:
        if self._device.nodes is not self._nodes or not self._device.plugged:
            raise SpinnakerException(IO, "The device is gone")
        return self._device


class FakeCameraList:
    def __init__(self, module: FakePySpin) -> None:
        self._cameras = [FakeCamera(device, module.pointers) for device in module.devices if device.plugged]

    def GetSize(self) -> int:  # noqa: N802
        return len(self._cameras)

    def GetByIndex(self, index: int) -> FakeCamera:  # noqa: N802
        return self._cameras[index]

    def Clear(self) -> None:  # noqa: N802
        self._cameras.clear()


class FakeSystem:
    """The singleton: made anew after each release."""

    def __init__(self, module: FakePySpin) -> None:
        self._module = module

    def GetCameras(self) -> FakeCameraList:  # noqa: N802
        return FakeCameraList(self._module)

    def ReleaseInstance(self) -> None:  # noqa: N802
        module = self._module
        if len(module.pointers) or any(device.initialised and device.plugged for device in module.devices):
            module.refused_releases += 1
            raise SpinnakerException(IN_USE, "Can't clear a camera because something still holds a reference to it")
        if module.system is not self:
            module.devices[0].mistakes.append("the system was released twice")
        module.system = None
        module.released += 1


class FakePySpin:
    """What ``import PySpin`` gives. made, released: how often the system was. pointers: to cameras and images."""

    SpinnakerException = SpinnakerException

    def __init__(self, *devices: FakeDevice) -> None:
        self.devices = list(devices)
        self.pointers: weakref.WeakSet[Any] = weakref.WeakSet()
        self.system: FakeSystem | None = None
        self.made = self.released = self.refused_releases = 0
        self.System = self

    def GetInstance(self) -> FakeSystem:  # noqa: N802
        if self.system is None:
            self.system = FakeSystem(self)
            self.made += 1
        return self.system

    def IsAvailable(self, node: Any) -> bool:  # noqa: N802
        return bool(node.valid and node.available)

    IsReadable = IsAvailable

    def IsWritable(self, node: Any) -> bool:  # noqa: N802
        return bool(node.valid and node.writable)

    def CValuePtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name)

    def CIntegerPtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name, ("integer",))

    def CFloatPtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name, ("float",))

    def CBooleanPtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name, ("boolean",))

    def CEnumerationPtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name, ("enumeration",))

    def CCommandPtr(self, node: FakeNode) -> FakeNode:  # noqa: N802
        return FakeNode(node.nodes, node.name, ("command",))

    def CEnumEntryPtr(self, entry: FakeEntry) -> FakeEntry:  # noqa: N802
        return entry
