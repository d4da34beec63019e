"""Node maps of the stand-in for PySpin, and its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.gigevision.features import Feature

if TYPE_CHECKING:
    from fake_pyspin import FakeDevice

IN_USE, DENIED, IO, TIMEOUT, RANGE, ACCESS, NULL = -1004, -1005, -1010, -1011, -2002, -2006, -2005


class SpinnakerException(Exception):  # noqa: N818
    """errorcode: as in Spinnaker::Error."""

    def __init__(self, errorcode: int, text: str) -> None:
        super().__init__(f"Spinnaker: {text} [{errorcode}]")
        self.errorcode = errorcode


class FakeNodes:
    """A node map. texts: features that are texts. stuck: features that do not keep what is written."""

    def __init__(self, features: tuple[Feature, ...], texts: dict[str, str] | None = None) -> None:
        self.features = {feature.name: feature for feature in features}
        self.values: dict[str, float] = {feature.name: feature.default for feature in features}
        self.texts = texts or {}
        self.cache: dict[str, Any] = {}
        self.stuck: set[str] = set()
        self.reachable = True
        self.device: FakeDevice | None = None

    def GetNode(self, name: str) -> FakeNode | None:  # noqa: N802
        return FakeNode(self, name) if name in self.features or name in self.texts else None

    def entry(self, name: str) -> str:
        """The entry that an enumeration holds."""
        return self.features[name].entries[int(self.values[name])]

    def choose(self, name: str, entry: str) -> None:
        """Change an enumeration behind the driver's back."""
        self.values[name] = self.features[name].entries.index(entry)


class FakeNode:
    """A feature, and whatever pointer to it was made."""

    def __init__(self, nodes: FakeNodes, name: str, kinds: tuple[str, ...] = ()) -> None:
        self.nodes, self.name = nodes, name
        self.feature = nodes.features.get(name)
        self.kind = self.feature.kind if self.feature else "string"
        self.valid = not kinds or self.kind in kinds

    @property
    def available(self) -> bool:
        feature = self.feature
        if not self.valid:
            return False
        if self.name == "TriggerOverlap" and self.nodes.entry("TriggerSelector") != "FrameStart":
            return False
        return feature is None or feature.available is None or feature.available.holds(self.nodes.values)

    @property
    def writable(self) -> bool:
        feature = self.feature
        if not self.available or feature is None or feature.access == "RO":
            return False
        return not any(condition.holds(self.nodes.values) for condition in feature.locked)

    def ToString(self, verify: bool = False, ignore_cache: bool = False) -> str:  # noqa: N802
        value = self.GetValue(verify, ignore_cache)
        return self.feature.entries[int(value)] if self.feature and self.kind == "enumeration" else str(value)

    def GetValue(self, verify: bool = False, ignore_cache: bool = False) -> Any:  # noqa: N802
        if not self.available:
            raise SpinnakerException(ACCESS, f"Node {self.name} is not readable")
        if not ignore_cache and self.name in self.nodes.cache:
            return self.nodes.cache[self.name]
        self._reach()
        value = self.nodes.texts[self.name] if self.feature is None else self._held()
        self.nodes.cache[self.name] = value
        return value

    def SetValue(self, value: float) -> None:  # noqa: N802
        assert self.feature is not None
        if not self.writable:
            raise SpinnakerException(ACCESS, f"Node {self.name} is not writable")
        low, high = self.GetMin(), self.GetMax()
        if self.kind in ("integer", "float") and not low <= value <= high:
            raise SpinnakerException(RANGE, f"Value {value} must be in {low} .. {high}")
        if self.kind == "integer" and (value - low) % self.GetInc():
            raise SpinnakerException(RANGE, f"Value {value} is off the increment")
        self._reach()
        self.nodes.cache[self.name] = value
        if self.name not in self.nodes.stuck:
            step = self.feature.step if self.kind == "float" else 1
            self.nodes.values[self.name] = round(value / step) * step

    def SetIntValue(self, value: int) -> None:  # noqa: N802
        self.SetValue(value)

    def GetEntryByName(self, entry: str) -> FakeEntry | None:  # noqa: N802
        assert self.feature is not None
        entries = self.feature.entries
        return FakeEntry(entries.index(entry)) if entry in entries else None

    def GetMin(self) -> float:  # noqa: N802
        assert self.feature is not None
        return self.feature.minimum

    def GetMax(self) -> float:  # noqa: N802
        assert self.feature is not None
        return self.feature.maximum - (self.nodes.values[self.feature.less] if self.feature.less else 0)

    def GetInc(self) -> int:  # noqa: N802
        assert self.feature is not None
        return int(self.feature.step)

    def Execute(self) -> None:  # noqa: N802
        self._reach()
        assert self.nodes.device is not None
        self.nodes.device.execute(self.name)

    def _held(self) -> Any:
        value = self.nodes.values[self.name]
        if self.name == "AcquisitionStatus" and self.nodes.device is not None:
            return self.nodes.device.waits_for_trigger()
        kinds: dict[str, type] = {"integer": int, "float": float, "boolean": bool, "enumeration": int}
        return kinds[self.kind](value)

    def _reach(self) -> None:
        if not self.nodes.reachable:
            raise SpinnakerException(IO, "Unable to reach the device")


@dataclass(frozen=True)
class FakeEntry:
    """An entry of an enumeration."""

    number: int
    available: bool = True
    valid: bool = True

    def GetValue(self) -> int:  # noqa: N802
        return self.number
