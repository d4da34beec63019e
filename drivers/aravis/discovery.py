"""Which cameras answer, and whether one still does."""

from __future__ import annotations

import ipaddress
import secrets
import socket
import threading
import time

from drivers.aravis.library import Library, load_library
from drivers.errors import DeviceNotFoundError
from drivers.genicam.finding import FoundCamera, pick_camera
from drivers.gigevision.protocol import CONTROL_PORT, Bootstrap, Command, make_request, parse_answer

_TRIES_S = (0.05, 0.1, 0.2, 0.4)
_LISTING = threading.Lock()


def find_cameras(library: str | None = None, device: str = "camera") -> list[FoundCamera]:
    """Every camera that answers within the second that this takes. DeviceUnavailableError without the library."""
    return _listed(load_library(device, library))


def locate(library: Library, device: str, serial: str | None, address: str | None) -> FoundCamera:
    """The camera with this serial number or address, or the only one there is.

    Raises DeviceNotFoundError. A GigE Vision camera with a known address is asked for directly, which takes no second.
    """
    if address is not None:
        if privilege(address) is None:
            raise DeviceNotFoundError(device, f"no camera answers at {address}; check its cable, power and address")
        return FoundCamera(address, "", serial or "", address, "GigEVision")
    return pick_camera(_listed(library), device, serial)


def privilege(address: str) -> int | None:
    """Control register of a GigE Vision camera: 0 while nobody controls it; None where it does not answer."""
    number = secrets.randbelow(0xFFFF) + 1
    request = make_request(Command.READ_REGISTERS, number, int(Bootstrap.PRIVILEGE).to_bytes(4, "big"))
    try:
        asking = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    except OSError:  # no more files, or no network at all
        return None
    with asking:
        for patience_s in _TRIES_S:
            try:
                asking.sendto(request, (address, CONTROL_PORT))
            except OSError:  # no way there
                return None
            answer = _await_answer(asking, number, patience_s)
            if answer is not None and len(answer) == 4:
                return int.from_bytes(answer, "big")
    return None


def is_loopback(address: str) -> bool:
    """Whether a camera is a program on this machine."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def _await_answer(asking: socket.socket, number: int, patience_s: float) -> bytes | None:
    deadline = time.monotonic() + patience_s
    while (left_s := deadline - time.monotonic()) > 0:
        asking.settimeout(left_s)
        try:
            packet = asking.recv(1024)
        except OSError:  # too late, or refused
            return None
        body = parse_answer(packet, Command.READ_REGISTERS, number)
        if body is not None:
            return body
    return None


def _listed(library: Library) -> list[FoundCamera]:
    def text(name: str, index: int) -> str:
        return (library.call(f"get_device_{name}", index) or b"").decode(errors="replace")

    with _LISTING:
        library.call("update_device_list")
        return [
            FoundCamera(*(text(name, index) for name in ("id", "model", "serial_nbr", "address", "protocol")))
            for index in range(library.call("get_n_devices"))
        ]
