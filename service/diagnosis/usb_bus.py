"""What the system knows of the rig's USB devices without opening them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CAMERA_VENDOR = "1e10"
"""Point Grey, now FLIR."""
_RULE_FOLDERS = ("etc/udev/rules.d", "run/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d")
"""A file of an earlier one hides those of its name in the later ones (udev(7))."""
_MATCH = re.compile(
    r'\s*(?P<key>[A-Z]+(?:\{[^}]*\})?)\s*(?P<operator>==|!=|\+=|-=|:=|=)\s*"(?P<value>[^"]*)"\s*(?:,|$)'
)
_GIVES_ACCESS = ("MODE", "GROUP", "OWNER")


@dataclass(frozen=True)
class UsbId:
    """Vendor and product as four hexadecimal digits each; product None for any."""

    vendor: str
    product: str | None = None

    def __str__(self) -> str:
        return self.vendor if self.product is None else f"{self.vendor}:{self.product}"


@dataclass(frozen=True)
class UsbDevice:
    """An attached device. speed_mbps: of its link, 5000 for USB 3; None where the system does not tell.

    node: the file that is opened to talk to it.
    """

    id: UsbId
    serial: str
    speed_mbps: float | None
    node: Path


def attached(wanted: UsbId, root: Path) -> list[UsbDevice]:
    """The devices of this vendor and product, in the order of their places on the bus."""
    found = (_device(folder, root) for folder in sorted((root / "sys/bus/usb/devices").glob("*")))
    return [
        device
        for device in found
        if device is not None and device.id.vendor == wanted.vendor and wanted.product in (None, device.id.product)
    ]


def has_rule(wanted: UsbId, root: Path) -> bool:
    """Whether any udev rule gives somebody access to this device."""
    return any(_rule_covers(line, wanted) for text in _rule_files(root) for line in _rules(text))


def usbfs_memory_mb(root: Path) -> int | None:
    """Memory for transfers, of all USB devices together, MiB; 0 is no limit. None where the kernel does not tell."""
    text = _text(root / "sys/module/usbcore/parameters/usbfs_memory_mb")
    return int(text) if text.isdecimal() else None


def _device(folder: Path, root: Path) -> UsbDevice | None:
    """None for what is no device: an interface, or one that has just gone."""
    vendor, product = _text(folder / "idVendor").lower(), _text(folder / "idProduct").lower()
    bus, number = _text(folder / "busnum"), _text(folder / "devnum")
    if not (vendor and product and bus.isdecimal() and number.isdecimal()):
        return None
    speed = _text(folder / "speed")
    try:
        speed_mbps = float(speed)
    except ValueError:
        speed_mbps = None
    node = root / f"dev/bus/usb/{int(bus):03d}/{int(number):03d}"
    return UsbDevice(UsbId(vendor, product), _text(folder / "serial"), speed_mbps, node)


def _rule_files(root: Path) -> Iterator[str]:
    seen: set[str] = set()
    for folder in _RULE_FOLDERS:
        for file in sorted((root / folder).glob("*.rules")):
            if file.name not in seen:
                seen.add(file.name)
                yield _text(file)


def _rules(text: str) -> Iterator[str]:
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            yield line


def _rule_covers(line: str, wanted: UsbId) -> bool:
    parts = list(_MATCH.finditer(line))
    asked = {(p["key"].partition("{")[2].rstrip("}"), p["value"].lower()) for p in parts if p["operator"] == "=="}
    sets = {p["key"] for p in parts if p["operator"] in ("=", ":=")}
    products = {value for key, value in asked if key == "idProduct"}
    return (
        ("idVendor", wanted.vendor) in asked
        and (not products or wanted.product in products)
        and not sets.isdisjoint(_GIVES_ACCESS)
    )


def _text(path: Path) -> str:
    """Empty where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
