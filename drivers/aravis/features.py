"""Features of a camera through Aravis."""

from __future__ import annotations

import ctypes
from typing import TypeVar

from drivers.aravis.library import AravisError, Library
from drivers.errors import DeviceConfigurationError, DriverError
from drivers.genicam.features import Features, Value

_V = TypeVar("_V", bound="str | float | bool")
_KIND: dict[type, str] = {str: "string", bool: "boolean", int: "integer", float: "float"}


class AravisFeatures(Features):
    """camera: the library's handle."""

    def __init__(self, library: Library, camera: int, device: str) -> None:
        super().__init__(device)
        self._library, self._camera = library, camera

    def has(self, name: str) -> bool:
        try:
            return bool(self._library.call("camera_is_feature_available", self._camera, name.encode()))
        except AravisError as error:
            if error.is_silence:
                raise self._lost() from error
            return False

    def offers(self, name: str, entry: str) -> bool:
        if not self.has(name):
            return False
        try:
            return bool(
                self._library.call("camera_is_enumeration_entry_available", self._camera, name.encode(), entry.encode())
            )
        except AravisError as error:
            if error.is_silence:
                raise self._lost() from error
            return False

    def read(self, name: str, kind: type[_V]) -> _V:
        try:
            value = self._library.call(f"camera_get_{_KIND[kind]}", self._camera, name.encode())
        except AravisError as error:
            raise self._refused(name, "read", error) from error
        return kind(value.decode(errors="replace") if isinstance(value, bytes) else value if value is not None else "")

    def _set(self, name: str, value: Value) -> None:
        raw = value.encode() if isinstance(value, str) else value
        try:
            self._library.call(f"camera_set_{_KIND[type(value)]}", self._camera, name.encode(), raw)
        except AravisError as error:
            raise self._refused(name, value, error) from error

    def execute(self, name: str) -> None:
        try:
            self._library.call("camera_execute_command", self._camera, name.encode())
        except AravisError as error:
            raise self._refused(name, "executed", error) from error

    def integer_range(self, name: str) -> tuple[int, int, int]:
        low, high = ctypes.c_int64(), ctypes.c_int64()
        try:
            self._library.call(
                "camera_get_integer_bounds", self._camera, name.encode(), ctypes.byref(low), ctypes.byref(high)
            )
            step = self._library.call("camera_get_integer_increment", self._camera, name.encode())
        except AravisError as error:
            raise self._refused(name, "asked for its range", error) from error
        return low.value, high.value, max(1, int(step))

    def float_range(self, name: str) -> tuple[float, float]:
        low, high = ctypes.c_double(), ctypes.c_double()
        try:
            self._library.call(
                "camera_get_float_bounds", self._camera, name.encode(), ctypes.byref(low), ctypes.byref(high)
            )
        except AravisError as error:
            raise self._refused(name, "asked for its range", error) from error
        return low.value, high.value

    def _refused(self, name: str, wanted: object, error: AravisError) -> DriverError:
        if error.is_silence:
            return self._lost()
        return DeviceConfigurationError(self._device, name, wanted, f"the camera says: {error}")
