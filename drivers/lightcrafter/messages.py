"""USB messages of the controller: a header, a payload, 64-byte reports without a report id.

The first report carries the header; a longer message goes on in raw reports without one. A reply has the header's
sequence number back, and its data begins right after the length.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.errors import ProtocolError
from drivers.lightcrafter.commands import NAME

REPORT_BYTES = 64
HEADER_BYTES = 4
COMMAND_BYTES = 2
MAXIMUM_PAYLOAD = 512 - HEADER_BYTES - COMMAND_BYTES
"""Longest payload of one message."""
_READ, _REPLY, _NACK = 0x80, 0x40, 0x20
_HEADER = struct.Struct("<BBH")


@dataclass(frozen=True)
class Request:
    """A message to the controller. code: CMD2 and CMD3 as one number. acknowledged: a reply is wanted."""

    code: int
    sequence: int
    payload: bytes = b""
    read: bool = False
    acknowledged: bool = True

    def encode(self) -> bytes:
        """Whole reports, zero-padded."""
        if len(self.payload) > MAXIMUM_PAYLOAD:
            raise ProtocolError(
                NAME, f"cannot be sent {len(self.payload)} bytes at once; {MAXIMUM_PAYLOAD} are the most"
            )
        flags = _READ * self.read | _REPLY * self.acknowledged
        header = _HEADER.pack(flags, self.sequence, COMMAND_BYTES + len(self.payload))
        return _padded(header + self.code.to_bytes(COMMAND_BYTES, "little") + self.payload)

    @classmethod
    def decode(cls, data: bytes) -> Request:
        """The request of whole reports; ProtocolError where they are none."""
        flags, sequence, length = _header(data)
        if length < COMMAND_BYTES or len(data) < HEADER_BYTES + length:
            raise ProtocolError(NAME, f"was sent a message of {length} bytes in {len(data)}")
        body = data[HEADER_BYTES : HEADER_BYTES + length]
        code = int.from_bytes(body[:COMMAND_BYTES], "little")
        return cls(code, sequence, body[COMMAND_BYTES:], bool(flags & _READ), bool(flags & _REPLY))


@dataclass(frozen=True)
class Reply:
    """A message from the controller. refused: it did not accept the request."""

    sequence: int
    data: bytes = b""
    refused: bool = False

    def encode(self, flags: int = 0) -> bytes:
        """Whole reports, zero-padded. flags: further bits of the first byte, whose meaning nobody tells."""
        return _padded(_HEADER.pack(flags & ~_NACK | _NACK * self.refused, self.sequence, len(self.data)) + self.data)

    @classmethod
    def decode(cls, data: bytes) -> Reply:
        """The reply of whole reports. Only the bit of refusal is read of the flags; ProtocolError where it is cut."""
        flags, sequence, length = _header(data)
        if len(data) < HEADER_BYTES + length:
            raise ProtocolError(NAME, f"sent {len(data) - HEADER_BYTES} bytes of an answer of {length}")
        return cls(sequence, data[HEADER_BYTES : HEADER_BYTES + length], bool(flags & _NACK))


def reports_of(first: bytes) -> int:
    """How many reports the message has that begins with this one; ProtocolError where it begins none."""
    length = _header(first)[2]
    if length > COMMAND_BYTES + MAXIMUM_PAYLOAD:
        raise ProtocolError(NAME, f"announced an answer of {length} bytes; no answer is so long")
    return -(-(HEADER_BYTES + length) // REPORT_BYTES)


def _header(data: bytes) -> tuple[int, int, int]:
    if len(data) < HEADER_BYTES:
        raise ProtocolError(NAME, f"sent a report of {len(data)} bytes; {REPORT_BYTES} belong in one")
    flags, sequence, length = _HEADER.unpack_from(data)
    return flags, sequence, length


def _padded(message: bytes) -> bytes:
    return message.ljust(-(-len(message) // REPORT_BYTES) * REPORT_BYTES, b"\0")
