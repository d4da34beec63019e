"""Features of a camera, or of the host's side of its stream, through the node maps of Spinnaker."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from drivers.errors import DeviceConfigurationError, DriverError
from drivers.genicam.features import Features, Value
from drivers.spinnaker.library import NO_ACCESS, NOT_AVAILABLE, Spinnaker, SpinnakerError

_V = TypeVar("_V", bound="str | float | bool")
_T = TypeVar("_T")
_POINTER: dict[type, str] = {str: "CValuePtr", bool: "CBooleanPtr", int: "CIntegerPtr", float: "CFloatPtr"}
_UNVERIFIED, _PAST_THE_CACHE = False, True
"""Arguments of GetValue and ToString: read from the camera itself, which alone tells that it is there."""


class SpinnakerFeatures(Features):
    """nodes: a node map. It must not be used after its camera was let go."""

    def __init__(self, spinnaker: Spinnaker, nodes: Any, device: str) -> None:
        super().__init__(device)
        self._spinnaker, self._module, self._nodes = spinnaker, spinnaker.module, nodes

    def has(self, name: str) -> bool:
        return self._answer(lambda: self._is_there(self._nodes.GetNode(name)))

    def offers(self, name: str, entry: str) -> bool:
        def offered() -> bool:
            node = self._nodes.GetNode(name)
            if not self._is_there(node):
                return False
            known = self._module.CEnumerationPtr(node).GetEntryByName(entry)
            return known is not None and self._is_there(self._module.CEnumEntryPtr(known))

        return self._answer(offered)

    def read(self, name: str, kind: type[_V]) -> _V:
        def held() -> Any:
            node = self._readable(name, _POINTER[kind])
            get = node.ToString if kind is str else node.GetValue
            return get(_UNVERIFIED, _PAST_THE_CACHE)

        return kind(self._done(name, "read", held))

    def execute(self, name: str) -> None:
        self._done(name, "executed", lambda: self._writable(name, "CCommandPtr").Execute())

    def integer_range(self, name: str) -> tuple[int, int, int]:
        def asked() -> tuple[int, int, int]:
            node = self._readable(name, "CIntegerPtr")
            return node.GetMin(), node.GetMax(), max(1, node.GetInc())

        return self._done(name, "asked for its range", asked)

    def float_range(self, name: str) -> tuple[float, float]:
        def asked() -> tuple[float, float]:
            node = self._readable(name, "CFloatPtr")
            return node.GetMin(), node.GetMax()

        return self._done(name, "asked for its range", asked)

    def _set(self, name: str, value: Value) -> None:
        def written() -> None:
            if not isinstance(value, str):
                self._writable(name, _POINTER[type(value)]).SetValue(value)
                return
            node = self._writable(name, "CEnumerationPtr")
            entry = node.GetEntryByName(value)
            if entry is None:
                raise SpinnakerError(NOT_AVAILABLE, f"it has no entry {value}")
            node.SetIntValue(self._module.CEnumEntryPtr(entry).GetValue())

        self._done(name, value, written)

    def _readable(self, name: str, pointer: str) -> Any:
        return self._accessible(name, pointer, self._module.IsReadable, "it cannot be read now")

    def _writable(self, name: str, pointer: str) -> Any:
        return self._accessible(name, pointer, self._module.IsWritable, "it is locked now")

    def _accessible(self, name: str, pointer: str, access: Callable[[Any], bool], problem: str) -> Any:
        node = self._nodes.GetNode(name)
        if not self._is_there(node):
            raise SpinnakerError(NOT_AVAILABLE, "the camera has no such feature now")
        typed = getattr(self._module, pointer)(node)
        if not access(typed):
            raise SpinnakerError(NO_ACCESS, problem)
        return typed

    def _is_there(self, node: Any) -> bool:
        return node is not None and bool(self._module.IsAvailable(node))

    def _answer(self, question: Callable[[], bool]) -> bool:
        try:
            return bool(self._spinnaker.call(question))
        except SpinnakerError as error:
            if error.is_silence:
                raise self._lost() from error
            return False

    def _done(self, name: str, wanted: object, action: Callable[[], _T]) -> _T:
        try:
            result: _T = self._spinnaker.call(action)
        except SpinnakerError as error:
            raise self._refused(name, wanted, error) from error
        return result

    def _refused(self, name: str, wanted: object, error: SpinnakerError) -> DriverError:
        if error.is_silence:
            return self._lost()
        return DeviceConfigurationError(self._device, name, wanted, f"the camera says: {error}")
