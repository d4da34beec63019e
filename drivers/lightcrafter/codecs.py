"""Payloads of the controller's commands: values to bytes and back. Everything is little-endian."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from drivers.lightcrafter.values import (
    Input,
    LedSelect,
    LutControl,
    LutEntry,
    Release,
    Source,
    Trigger,
    Versions,
    Width,
)

T = TypeVar("T")
R = TypeVar("R", bound=NamedTuple)
ENTRY_BYTES = 3


class PayloadError(ValueError):
    """A value that does not fit its field, or bytes that are no such value."""


@dataclass(frozen=True)
class Codec(Generic[T]):
    """size: bytes of a payload, None where they vary. ``encode`` and ``decode`` raise PayloadError."""

    size: int | None
    to_bytes: Callable[[T], bytes]
    to_value: Callable[[bytes], T]

    def encode(self, value: T) -> bytes:
        try:
            return self.to_bytes(value)
        except (struct.error, ValueError, OverflowError) as error:
            raise PayloadError(f"{value} does not fit its field") from error

    def decode(self, data: bytes) -> T:
        """``data`` may be padded; what lies beyond ``size`` is ignored."""
        if self.size is not None:
            if len(data) < self.size:
                raise PayloadError(f"{len(data)} bytes came where {self.size} belong")
            data = data[: self.size]
        try:
            return self.to_value(data)
        except (struct.error, ValueError, UnicodeDecodeError) as error:
            raise PayloadError(f"{data.hex(' ') or 'nothing'} has no meaning") from error


def byte(kind: Callable[[int], T], mask: int = 0xFF) -> Codec[T]:
    """One byte; bits outside ``mask`` are ignored when it is read."""

    def encode(value: T) -> bytes:
        return bytes([int(value)])  # type: ignore[call-overload]  # every kind here is an int

    return Codec(1, encode, lambda data: kind(data[0] & mask))


def integer(size: int) -> Codec[int]:
    """An unsigned number of ``size`` bytes."""
    return Codec(size, lambda value: value.to_bytes(size, "little"), lambda data: int.from_bytes(data, "little"))


def fields(kind: type[R], layout: str) -> Codec[R]:
    """A NamedTuple of numbers in the layout of ``struct``."""
    packing = struct.Struct("<" + layout)

    def decode(data: bytes) -> R:
        made: R = kind._make(packing.unpack(data))
        return made

    return Codec(packing.size, lambda value: packing.pack(*value), decode)


def _encode_release(release: Release) -> int:
    major, minor, patch = release
    if not (0 <= major < 256 and 0 <= minor < 256 and 0 <= patch < 65536):
        raise ValueError(release)
    return major << 24 | minor << 16 | patch


def _decode_versions(data: bytes) -> Versions:
    return Versions._make(Release(w >> 24, w >> 16 & 0xFF, w & 0xFFFF) for w in struct.unpack("<4I", data))


def _encode_control(control: LutControl) -> bytes:
    if control.entries > 128 or control.images > 64:
        raise ValueError(control)
    return bytes([control.entries - 1, control.repeat, control.patterns - 1, control.images - 1])


def _decode_control(data: bytes) -> LutControl:
    return LutControl(data[0] + 1, bool(data[1] & 1), data[2] + 1, data[3] + 1)


def encode_entry(entry: LutEntry) -> bytes:
    """The three bytes of one pattern."""
    last = entry.inverted | entry.black << 1 | entry.swap << 2 | entry.share << 3
    return bytes([entry.trigger | entry.number << 2, entry.depth | entry.leds << 4, last])


def decode_entry(data: bytes) -> LutEntry:
    """The pattern of three bytes; ValueError for a depth of 0 or beyond 8."""
    first, second, last = data
    return LutEntry(
        number=first >> 2,
        depth=second & 0x0F,
        trigger=Trigger(first & 3),
        leds=LedSelect(second >> 4 & 7),
        inverted=bool(last & 1),
        black=bool(last & 2),
        swap=bool(last & 4),
        share=bool(last & 8),
    )


def _decode_entries(data: bytes) -> tuple[LutEntry, ...]:
    return tuple(decode_entry(data[at : at + ENTRY_BYTES]) for at in range(0, len(data), ENTRY_BYTES))


def _encode_input(chosen: Input) -> bytes:
    return bytes([chosen.source | chosen.width << 3])


def _decode_input(data: bytes) -> Input:
    return Input(Source(data[0] & 7), Width(data[0] >> 3 & 7))


def _decode_tag(data: bytes) -> str:
    return data.split(b"\0")[0].decode("ascii").strip()


VERSIONS: Codec[Versions] = Codec(
    16, lambda versions: struct.pack("<4I", *map(_encode_release, versions)), _decode_versions
)
LUT_CONTROL: Codec[LutControl] = Codec(4, _encode_control, _decode_control)
INPUT: Codec[Input] = Codec(1, _encode_input, _decode_input)
ENTRIES: Codec[tuple[LutEntry, ...]] = Codec(
    None, lambda entries: b"".join(map(encode_entry, entries)), _decode_entries
)
INDEXES: Codec[tuple[int, ...]] = Codec(None, bytes, tuple)
TAG: Codec[str] = Codec(None, lambda tag: tag.encode("ascii")[:31].ljust(32, b"\0"), _decode_tag)
