"""The camera's memory: what a register holds, what may be written into it, what a write starts."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping

from drivers.gigevision.features import FEATURES, Feature
from drivers.gigevision.protocol import DISCOVERY_BYTES, Bootstrap, Status
from drivers.gigevision.xml import entry_value, genicam_xml

_FIRST, _STRIDE = 0x1_0000, 8
_XML = 0x10_0000
_WRITABLE = (
    Bootstrap.HEARTBEAT_MS,
    Bootstrap.PRIVILEGE,
    Bootstrap.STREAM_PORT,
    Bootstrap.PACKET_SIZE,
    Bootstrap.PACKET_DELAY,
    Bootstrap.STREAM_ADDRESS,
)


class Registers:
    """Not safe against threads. on_read: makes a feature's value up when asked. on_write: told after each write.

    stuck: features that take a write and do not hold it.
    """

    def __init__(
        self,
        identity: Mapping[Bootstrap, bytes],
        on_read: Mapping[str, Callable[[], float]],
        on_write: Callable[[str], None],
    ) -> None:
        self._identity = identity
        self._on_read, self._on_write = on_read, on_write
        self._at = {_FIRST + _STRIDE * i: feature for i, feature in enumerate(FEATURES)}
        self._features = {feature.name: feature for feature in FEATURES}
        addresses = {feature.name: address for address, feature in self._at.items()}
        vendor, model = (identity[key].decode() for key in (Bootstrap.VENDOR, Bootstrap.MODEL))
        self._xml = genicam_xml(FEATURES, addresses, vendor, model)
        self.reset()

    def reset(self) -> None:
        """As after switching on."""
        self.stuck: set[str] = set()
        self.values: dict[str, float] = {feature.name: _default(feature) for feature in FEATURES}
        self._bootstrap = bytearray(0x1000)
        for address, content in self._identity.items():
            self._bootstrap[address : address + len(content)] = content
        url = f"Local:camera.xml;{_XML:x};{len(self._xml):x}".encode()
        self._bootstrap[Bootstrap.XML_URL : Bootstrap.XML_URL + len(url)] = url

    @property
    def discovery(self) -> bytes:
        return bytes(self._bootstrap[:DISCOVERY_BYTES])

    def bootstrap(self, register: Bootstrap) -> int:
        return int.from_bytes(self._bootstrap[register : register + 4], "big")

    def set_bootstrap(self, register: Bootstrap, value: int) -> None:
        self._bootstrap[register : register + 4] = value.to_bytes(4, "big")

    def entry(self, name: str) -> str:
        """The entry that an enumeration stands on."""
        feature = self._features[name]
        return next(e for i, e in enumerate(feature.entries) if entry_value(feature, i) == self.values[name])

    def read(self, address: int, count: int) -> bytes | None:
        """None where no register lies."""
        if address + count <= len(self._bootstrap):
            return bytes(self._bootstrap[address : address + count])
        if address >= _XML:
            part = self._xml[address - _XML : address - _XML + count]
            return part + bytes(count - len(part)) if part else None
        feature = self._at.get(address)
        if feature is None or count != feature.size:
            return None
        made = self._on_read.get(feature.name)
        value = self.values[feature.name] if made is None else made()
        return struct.pack(">d", value) if feature.kind == "float" else int(value).to_bytes(4, "big")

    def write(self, address: int, content: bytes) -> Status:
        """Refuses what a real camera refuses: read-only, locked, out of range, out of step."""
        if address < len(self._bootstrap):
            if address not in _WRITABLE or len(content) != 4:
                return Status.WRITE_PROTECT
            self._bootstrap[address : address + 4] = content
            self._on_write(Bootstrap(address).name)
            return Status.SUCCESS
        feature = self._at.get(address)
        if feature is None or len(content) != feature.size:
            return Status.INVALID_ADDRESS
        if feature.access == "RO":
            return Status.WRITE_PROTECT
        if self._is_locked(feature):
            return Status.ACCESS_DENIED
        value = struct.unpack(">d", content)[0] if feature.kind == "float" else int.from_bytes(content, "big")
        if not self._takes(feature, value):
            return Status.INVALID_PARAMETER
        if feature.kind == "float":
            value = min(max(feature.step * round(value / feature.step), feature.minimum), feature.maximum)
        if feature.kind != "command" and feature.name not in self.stuck:
            self.values[feature.name] = value
        self._on_write(feature.name)
        return Status.SUCCESS

    def _is_locked(self, feature: Feature) -> bool:
        there = feature.available is None or feature.available.holds(self.values)
        return not there or any(condition.holds(self.values) for condition in feature.locked)

    def _takes(self, feature: Feature, value: float) -> bool:
        if feature.kind == "enumeration":
            return value in {entry_value(feature, i) for i in range(len(feature.entries))}
        most = feature.maximum - (self.values[feature.less] if feature.less else 0)
        in_step = feature.kind == "float" or (value - feature.minimum) % feature.step == 0
        return feature.minimum <= value <= most and in_step


def _default(feature: Feature) -> float:
    return entry_value(feature, int(feature.default)) if feature.kind == "enumeration" else feature.default
