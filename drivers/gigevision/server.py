"""The control socket of a simulated camera: discovery, registers, one controller at a time, heartbeat."""

from __future__ import annotations

import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable

from drivers.gigevision.camera import CameraBody
from drivers.gigevision.faults import TriggerFaults
from drivers.gigevision.pictures import ImageMaker
from drivers.gigevision.protocol import (
    CAN_RESEND,
    CONTROL,
    CONTROL_PORT,
    EXCLUSIVE,
    Bootstrap,
    Command,
    Request,
    Status,
    make_answer,
    parse_request,
)
from drivers.gigevision.stream import FrameSender

VENDOR, MODEL, FIRMWARE = "Point Grey Research", "Grasshopper3 GS3-U3-23S6M", "2.23.3.0"
_BROADCAST = "255.255.255.255"
_HEARTBEAT_MS = 3000
_PACKET_SIZE = 8036
_MOST_MEMORY = 536
_PACKET_NUMBER = 0xFF_FFFF
_Peer = tuple[str, int]


class SimulatedGrasshopper:
    """A camera at ``address`` (127.x.y.z), from construction until ``close``; also a context manager.

    image: what it sees, a numbered ramp where None. on_start: called when acquisition starts, from the control thread.
    The control port is fixed by GigE Vision, so each needs its own address; OSError where that is taken. ``pulse`` is
    its trigger input.
    """

    def __init__(
        self, address: str, serial: str, image: ImageMaker | None = None, on_start: Callable[[], None] | None = None
    ) -> None:
        self.address, self.serial = address, serial
        self._control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._discovery = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._waker, self._wake = socket.socketpair()
        try:
            self._control.bind((address, CONTROL_PORT))
            self._discovery.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._discovery.bind((_BROADCAST, CONTROL_PORT))
        except OSError:
            for opened in (self._control, self._discovery, self._waker, self._wake):
                opened.close()
            raise
        self._sender = FrameSender(address)
        offset_ns = int.from_bytes(serial.encode()[-4:], "big") * 1000
        self._body = CameraBody(_identity(address, serial), self._sender, image, offset_ns, on_start)
        self._controller: _Peer | None = None
        self._heard_s = 0.0
        self._ended = False
        self._thread = threading.Thread(target=self._run, name=f"camera {address}", daemon=True)
        self._thread.start()

    def __enter__(self) -> SimulatedGrasshopper:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def pulse(
        self,
        line: str = "Line3",
        edge: str = "RisingEdge",
        at_s: float | None = None,
        image: ImageMaker | None = None,
    ) -> bool:
        """One edge on a line of the camera; whether it started an exposure.

        at_s: when it came, ``time.monotonic``, None for now: a train of pulses keeps its period on a busy machine.
        image: what that exposure sees, None for what the camera sees anyway.
        """
        return self._body.pulse(line, edge, at_s, image)

    def hears(self, line: str = "Line3") -> bool:
        """Whether it waits for edges on a line."""
        return self._body.hears(line)

    def plan_faults(self, faults: TriggerFaults) -> None:
        """What goes wrong at which pulse, from now on."""
        self._body.faults = faults

    def feature(self, name: str) -> float:
        """What a feature's register holds; the entry's number for enumerations."""
        with self._body.lock:
            return self._body.registers.values[name]

    def set_feature(self, name: str, value: float) -> None:
        """Change a register behind the controller's back."""
        with self._body.lock:
            self._body.registers.values[name] = value

    def stick(self, name: str) -> None:
        """From now on a feature takes what is written and keeps what it holds, until switched on again."""
        with self._body.lock:
            self._body.registers.stuck.add(name)

    def unplug(self) -> None:
        """Answer nothing and send nothing until ``plug``."""
        self._body.die()

    @property
    def unplugged(self) -> bool:
        """Whether it is silent, by ``unplug`` or by a fault."""
        return self._body.dead

    def plug(self, *, kept_power: bool = False) -> None:
        """Be there again, freshly switched on; or with all that it held, where only the network was gone."""
        if kept_power:
            self._body.dead = False
            return
        self._controller = None
        self._body.revive()

    def close(self) -> None:
        """Leave the network. Idempotent."""
        if self._ended:
            return
        self._ended = True
        self._wake.send(b"x")
        self._thread.join()
        self._body.close()
        self._sender.close()
        for opened in (self._control, self._discovery, self._waker, self._wake):
            opened.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            for readable in (self._control, self._discovery, self._waker):
                selector.register(readable, selectors.EVENT_READ)
            while not self._ended:
                for key, _ in selector.select(0.5):
                    if key.fileobj is not self._waker:
                        self._answer(*_receive(key.fileobj))
                self._check_heartbeat()

    def _answer(self, packet: bytes, peer: _Peer) -> None:
        request = parse_request(packet)
        if request is None or self._body.dead:
            return
        if peer == self._controller:
            self._heard_s = time.monotonic()
        with self._body.lock:
            answer = self._execute(request, peer)
        if answer is not None:
            self._control.sendto(answer, peer)

    def _execute(self, request: Request, peer: _Peer) -> bytes | None:
        body, registers = request.body, self._body.registers
        if request.command == Command.DISCOVERY:
            return make_answer(request, Status.SUCCESS, registers.discovery)
        if request.command == Command.READ_REGISTERS and len(body) % 4 == 0:
            values = [registers.read(address, 4) for (address,) in struct.iter_unpack(">I", body)]
            known = [value for value in values if value is not None]
            status = Status.SUCCESS if len(known) == len(values) else Status.INVALID_ADDRESS
            return make_answer(request, status, b"".join(known))
        if request.command == Command.READ_MEMORY and len(body) == 8:
            address, count = struct.unpack(">IxxH", body)
            content = registers.read(address, count) if count <= _MOST_MEMORY else None
            if content is None:
                return make_answer(request, Status.INVALID_ADDRESS)
            return make_answer(request, Status.SUCCESS, body[:4] + content)
        if request.command == Command.WRITE_REGISTERS and len(body) % 8 == 0:
            return self._write(request, peer, [(body[i : i + 4], body[i + 4 : i + 8]) for i in range(0, len(body), 8)])
        if request.command == Command.WRITE_MEMORY and len(body) > 4:
            return self._write(request, peer, [(body[:4], body[4:])])
        if request.command == Command.RESEND and len(body) >= 12:
            block, first, last = struct.unpack_from(">xxHII", body)
            self._sender.resend(block, first & _PACKET_NUMBER, last & _PACKET_NUMBER)
            return None
        return make_answer(request, Status.NOT_IMPLEMENTED)

    def _write(self, request: Request, peer: _Peer, writes: list[tuple[bytes, bytes]]) -> bytes:
        done, status = 0, Status.SUCCESS
        for place, content in writes:
            address = int.from_bytes(place, "big")
            status = self._write_one(address, content, peer)
            if status is not Status.SUCCESS:
                break
            done += 1 if request.command == Command.WRITE_REGISTERS else len(content)
        return make_answer(request, status, struct.pack(">HH", 0, done))

    def _write_one(self, address: int, content: bytes, peer: _Peer) -> Status:
        if self._controller not in (None, peer):
            return Status.ACCESS_DENIED
        if address == Bootstrap.PRIVILEGE:
            wanted = int.from_bytes(content, "big") & (CONTROL | EXCLUSIVE)
            self._controller = peer if wanted else None
            self._heard_s = time.monotonic()
            if not wanted:
                self._body.registers.set_bootstrap(Bootstrap.STREAM_PORT, 0)
                self._halt()
        elif self._controller is None:
            return Status.ACCESS_DENIED
        return self._body.registers.write(address, content)

    def _halt(self) -> None:
        self._body.registers.values["TLParamsLocked"] = 0
        self._body.stop()

    def _check_heartbeat(self) -> None:
        """A controller that fell silent loses its privilege."""
        if self._controller is None or self._body.dead:
            return
        limit_s = 1e-3 * self._body.registers.bootstrap(Bootstrap.HEARTBEAT_MS)
        if time.monotonic() - self._heard_s > limit_s:
            self._controller = None
            with self._body.lock:
                self._body.registers.set_bootstrap(Bootstrap.PRIVILEGE, 0)
            self._halt()


def _receive(readable: object) -> tuple[bytes, _Peer]:
    assert isinstance(readable, socket.socket)
    packet, peer = readable.recvfrom(2048)
    return packet, peer


def _identity(address: str, serial: str) -> dict[Bootstrap, bytes]:
    place = socket.inet_aton(address)
    numbers = {
        Bootstrap.VERSION: 0x0001_0002,
        Bootstrap.DEVICE_MODE: 0x8000_0001,
        Bootstrap.MAC_HIGH: 0x0200,
        Bootstrap.MAC_LOW: int.from_bytes(place, "big"),
        Bootstrap.IP_CONFIGURATION: 5,
        Bootstrap.SUBNET: 0xFF00_0000,
        Bootstrap.INTERFACES: 1,
        Bootstrap.STREAM_CHANNELS: 1,
        Bootstrap.CAPABILITY: CAN_RESEND,
        Bootstrap.HEARTBEAT_MS: _HEARTBEAT_MS,
        Bootstrap.TICKS_HIGH: 0,
        Bootstrap.TICKS_LOW: 1_000_000_000,
        Bootstrap.PACKET_SIZE: _PACKET_SIZE,
    }
    texts = {
        Bootstrap.VENDOR: VENDOR,
        Bootstrap.MODEL: MODEL,
        Bootstrap.FIRMWARE: FIRMWARE,
        Bootstrap.INFORMATION: "simulated",
        Bootstrap.SERIAL: serial,
    }
    return {
        Bootstrap.ADDRESS: place,
        **{register: number.to_bytes(4, "big") for register, number in numbers.items()},
        **{register: text.encode() for register, text in texts.items()},
    }
