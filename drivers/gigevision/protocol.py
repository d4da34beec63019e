"""GigE Vision as bytes: control packets (GVCP), stream packets (GVSP), bootstrap registers. All big-endian.

Source: the numbers of the GigE Vision 1.2 standard as free implementations use them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

CONTROL_PORT = 3956
_KEY = 0x42
_HEADER = struct.Struct(">BBHHH")
_ANSWER = struct.Struct(">HHHH")
HEADER_BYTES = _HEADER.size
PACKET_OVERHEAD = 36
"""IP, UDP and GVSP headers: what a packet size counts beside the pixels."""
TEST_PACKET_FLAG = 0x8000_0000
CAN_RESEND = 0x4
EXCLUSIVE = 0x1
CONTROL = 0x2


class Command(IntEnum):
    """What a controller asks; the answer's number is one higher."""

    DISCOVERY = 0x02
    RESEND = 0x40
    READ_REGISTERS = 0x80
    WRITE_REGISTERS = 0x82
    READ_MEMORY = 0x84
    WRITE_MEMORY = 0x86


class Status(IntEnum):
    """How a command ended."""

    SUCCESS = 0
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECT = 0x8004
    ACCESS_DENIED = 0x8006


class Bootstrap(IntEnum):
    """Addresses of registers that every camera has."""

    VERSION = 0x0000
    DEVICE_MODE = 0x0004
    MAC_HIGH = 0x0008
    MAC_LOW = 0x000C
    IP_CONFIGURATION = 0x0014
    ADDRESS = 0x0024
    SUBNET = 0x0034
    VENDOR = 0x0048
    MODEL = 0x0068
    FIRMWARE = 0x0088
    INFORMATION = 0x00A8
    SERIAL = 0x00D8
    XML_URL = 0x0200
    INTERFACES = 0x0600
    STREAM_CHANNELS = 0x0904
    CAPABILITY = 0x0934
    HEARTBEAT_MS = 0x0938
    TICKS_HIGH = 0x093C
    TICKS_LOW = 0x0940
    PRIVILEGE = 0x0A00
    STREAM_PORT = 0x0D00
    PACKET_SIZE = 0x0D04
    PACKET_DELAY = 0x0D08
    STREAM_ADDRESS = 0x0D18


DISCOVERY_BYTES = 0xF8
PIXEL_FORMATS = {"Mono8": 0x0108_0001, "Mono16": 0x0110_0007}


@dataclass(frozen=True)
class Request:
    """A control packet from a controller."""

    command: int
    number: int
    body: bytes


def parse_request(packet: bytes) -> Request | None:
    """None for what is no whole GVCP command."""
    if len(packet) < HEADER_BYTES:
        return None
    key, _, command, length, number = _HEADER.unpack_from(packet)
    body = packet[HEADER_BYTES : HEADER_BYTES + length]
    if key != _KEY or len(body) != length:
        return None
    return Request(command, number, body)


def make_request(command: Command, number: int, body: bytes) -> bytes:
    """A command that wants an answer."""
    return _HEADER.pack(_KEY, 0x01, command, len(body), number) + body


def make_answer(request: Request, status: Status, body: bytes = b"") -> bytes:
    return _ANSWER.pack(status, request.command + 1, len(body), request.number) + body


def parse_answer(packet: bytes, command: Command, number: int) -> bytes | None:
    """The body of a successful answer to this very command, else None."""
    if len(packet) < _ANSWER.size:
        return None
    status, answered, length, to = _ANSWER.unpack_from(packet)
    body = packet[_ANSWER.size : _ANSWER.size + length]
    if (status, answered, to) != (Status.SUCCESS, command + 1, number) or len(body) != length:
        return None
    return body


def leader(block: int, ticks: int, pixel_format: int, roi: tuple[int, int, int, int]) -> bytes:
    """First packet of a frame. ticks: device time. roi: width, height, x, y px."""
    return _stream_header(block, 1, 0) + struct.pack(">HHQIIIIIHH", 0, 1, ticks, pixel_format, *roi, 0, 0)


def payload_header(block: int, packet: int) -> bytes:
    """What goes before a packet's pixels; ``packet`` counts from 1."""
    return _stream_header(block, 3, packet)


def trailer(block: int, packet: int, height: int) -> bytes:
    """Last packet of a frame."""
    return _stream_header(block, 2, packet) + struct.pack(">HHI", 0, 1, height)


def probe_packet(size: int) -> bytes:
    """A packet that fills ``size`` bytes on the wire, to find out whether such pass."""
    return _stream_header(0, 0, 0) + bytes(max(0, size - PACKET_OVERHEAD))


def _stream_header(block: int, kind: int, packet: int) -> bytes:
    return struct.pack(">HHI", 0, block, kind << 24 | packet)
