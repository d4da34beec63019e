"""What the computer must offer to real devices: camera library, access to USB, memory for transfers, fast links."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from drivers.aravis.diagnosis import LibraryVersion, loaded_library
from drivers.errors import DeviceUnavailableError
from drivers.hardware import CamerasConfiguration
from drivers.lightcrafter.usb import PRODUCT, VENDOR
from drivers.registry import RigConfiguration
from service.diagnosis.symptom import Symptom
from service.diagnosis.usb_bus import CAMERA_VENDOR, UsbDevice, UsbId, attached, has_rule, usbfs_memory_mb

CAMERA = UsbId(CAMERA_VENDOR)
PROJECTOR = UsbId(f"{VENDOR:04x}", f"{PRODUCT:04x}")
_GOOD_LIBRARY = LibraryVersion(0, 8, 31)
"""The first release without known faults in the streams of USB3 cameras."""
_USBFS_MB = 1000
_USB3_MBPS = 5000
_INSTALL_RULES = (
    "in the folder of the sources: sudo install -m 644 docker/99-duofringe.rules /etc/udev/rules.d/ && "
    "sudo udevadm control --reload && sudo udevadm trigger --subsystem-match=usb"
)
_MORE_MEMORY = (
    f"echo {_USBFS_MB} | sudo tee /sys/module/usbcore/parameters/usbfs_memory_mb; for good: "
    f"echo 'w /sys/module/usbcore/parameters/usbfs_memory_mb - - - - {_USBFS_MB}' | "
    "sudo tee /etc/tmpfiles.d/duofringe.conf"
)


def examine_host(rig: RigConfiguration, root: Path) -> Iterator[Symptom]:
    """Nothing for rigs that need nothing of it. "auto" is hardware once any of it is on the bus."""
    cameras, projectors = attached(CAMERA, root), attached(PROJECTOR, root)
    hardware = rig.driver == "hardware" or (rig.driver == "auto" and bool(cameras or projectors))
    on_usb = hardware and _may_be_on_usb(rig.cameras)
    if hardware or rig.driver == "bench":
        reached = rig.cameras if hardware else CamerasConfiguration()
        if reached.driver == "aravis":
            yield from _libraries(reached, on_usb=on_usb)
    if on_usb:
        yield _cameras_there(cameras)
        yield from _access("cameras", CAMERA, cameras, root)
        yield _memory(root)
        yield from map(_speed, cameras)
    if hardware and rig.projector.connection == "usb":
        yield from _access("projector", PROJECTOR, projectors, root)
    elif hardware and (rig.projector.port or "").startswith("/"):
        yield _port(root / str(rig.projector.port).lstrip("/"))


def _may_be_on_usb(cameras: CamerasConfiguration) -> bool:
    return any(camera.address is None for camera in (cameras.left, cameras.right))


def _libraries(cameras: CamerasConfiguration, *, on_usb: bool) -> Iterator[Symptom]:
    for path in dict.fromkeys((cameras.left.library, cameras.right.library)):
        yield _library(path, on_usb=on_usb)


def _library(path: str | None, *, on_usb: bool) -> Symptom:
    subject = "camera library"
    try:
        library = loaded_library(path)
    except DeviceUnavailableError as error:
        return Symptom(subject, "fault", str(error), "apt-get install libaravis-0.8-0, or name it in rig.cameras")
    where = f"libaravis {library.version or 'of unknown release'} at {library.path or 'an unknown place'}"
    better = (
        f"take {_GOOD_LIBRARY} or later: Debian 13, or name the library of PyPI's aravis-python in "
        "rig.cameras.left.library and rig.cameras.right.library"
    )
    if library.version is None:
        return Symptom(subject, "warning", where, better)
    if library.version < _GOOD_LIBRARY and on_usb:
        return Symptom(subject, "warning", f"{where}, which may hang or lose images of USB3 cameras", better)
    return Symptom(subject, "ok", where)


def _cameras_there(cameras: list[UsbDevice]) -> Symptom:
    subject, serials = "cameras on USB", ", ".join(camera.serial or "without serial" for camera in cameras)
    text = f"{len(cameras)} of vendor {CAMERA}" + (f" ({serials})" if serials else "")
    if len(cameras) < 2:
        return Symptom(subject, "warning", text, "check cables and power, or set rig.cameras.*.address for GigE")
    return Symptom(subject, "ok", text)


def _access(what: str, wanted: UsbId, devices: list[UsbDevice], root: Path) -> Iterator[Symptom]:
    """Rules of this account's system may lie outside its container: writable nodes then prove more than files."""
    closed = [device for device in devices if not os.access(device.node, os.R_OK | os.W_OK)]
    is_root = os.geteuid() == 0
    subject = f"udev rule for {what}"
    if has_rule(wanted, root):
        yield Symptom(subject, "ok", f"there is one for USB {wanted}")
    elif devices and not closed and not is_root:
        yield Symptom(subject, "ok", f"none for USB {wanted}, but this account has access without")
    else:
        text = f"none for USB {wanted}" + ("; only root has access" if is_root and devices else "")
        yield Symptom(subject, "warning", text, _INSTALL_RULES)
    for device in closed:
        yield _closed(what, device)
    if devices and not closed:
        yield Symptom(f"access to {what}", "ok", ", ".join(str(device.node) for device in devices))


def _closed(what: str, device: UsbDevice) -> Symptom:
    subject = f"access to {what}"
    if not device.node.exists():
        text = f"{device.node} is not here, although USB {device.id} is attached"
        return Symptom(subject, "fault", text, "in a container pass /dev/bus/usb through (docker/compose.yaml, rig)")
    remedy = "install the udev rule, then sudo usermod -aG plugdev $USER, log in again and plug the device in again"
    return Symptom(subject, "fault", f"{device.node} may not be written to by this account", remedy)


def _memory(root: Path) -> Symptom:
    subject, memory = "usbfs memory", usbfs_memory_mb(root)
    if memory is None:
        return Symptom(subject, "warning", "this kernel does not tell it", "load usbcore; check that this is the host")
    if 0 < memory < _USBFS_MB:
        return Symptom(subject, "warning", f"{memory} MB; two cameras want {_USBFS_MB}", _MORE_MEMORY)
    return Symptom(subject, "ok", f"{memory} MB" if memory else "without limit")


def _speed(camera: UsbDevice) -> Symptom:
    subject = f"link of camera {camera.serial or camera.node.name}"
    if camera.speed_mbps is None:
        return Symptom(subject, "warning", "the system does not tell its speed", "plug the camera in again")
    text = f"{camera.speed_mbps:g} Mbit/s"
    if camera.speed_mbps < _USB3_MBPS:
        remedy = f"it needs {_USB3_MBPS}: plug it into a USB3 port, with a USB3 cable of at most 5 m, pushed home"
        return Symptom(subject, "fault", text, remedy)
    return Symptom(subject, "ok", text)


def _port(port: Path) -> Symptom:
    subject = "bridge to the projector"
    if not port.exists():
        return Symptom(subject, "fault", f"{port} is not there", "plug the bridge in, or set rig.projector.port")
    if not os.access(port, os.R_OK | os.W_OK):
        remedy = "sudo usermod -aG dialout $USER, then log in again"
        return Symptom(subject, "fault", f"{port} may not be written to by this account", remedy)
    return Symptom(subject, "ok", str(port))
