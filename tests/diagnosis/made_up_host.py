"""The parts of a file system from which the doctor learns about a computer."""

from __future__ import annotations

from pathlib import Path

RULE = 'SUBSYSTEM=="usb", ATTR{idVendor}=="1e10", MODE="0660", GROUP="plugdev"\n'
CAMERA, PROJECTOR = ("1e10", "3300"), ("0451", "6401")


class MadeUpHost:
    """Empty at first."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._attached = 0

    def attach(self, kind: tuple[str, str], serial: str = "", speed: str = "5000", *, node: bool = True) -> Path:
        """Plug a device in; the path of its node."""
        self._attached += 1
        vendor, product = kind
        self.write(f"sys/bus/usb/devices/2-{self._attached}:1.0/bInterfaceClass", "ef\n")
        for name, text in {
            "idVendor": vendor,
            "idProduct": product,
            "busnum": "2",
            "devnum": str(self._attached),
            "speed": speed,
            "serial": serial,
        }.items():
            self.write(f"sys/bus/usb/devices/2-{self._attached}/{name}", f"{text}\n")
        path = f"dev/bus/usb/002/{self._attached:03d}"
        return self.write(path, "") if node else self.root / path

    def allow_memory(self, megabytes: int) -> None:
        self.write("sys/module/usbcore/parameters/usbfs_memory_mb", f"{megabytes}\n")

    def add_rules(self, text: str, folder: str = "etc/udev/rules.d", name: str = "99-duofringe.rules") -> None:
        self.write(f"{folder}/{name}", text)

    def write(self, path: str, text: str) -> Path:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file
