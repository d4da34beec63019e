"""Features of a camera by name: every write is read back."""

from __future__ import annotations

import ctypes
import math
from typing import TypeVar

from drivers.aravis.library import AravisError, Library
from drivers.errors import DeviceConfigurationError, DeviceLostError, DriverError

Value = str | float | bool
"""Enumerations and texts are str; integers are int."""
_V = TypeVar("_V", bound="str | float | bool")
_KIND: dict[type, str] = {str: "string", bool: "boolean", int: "integer", float: "float"}
_FLOAT_STEP = 0.01
"""A float may be rounded by this share of it, or by this much, to the camera's own steps."""


class Features:
    """Not safe against threads. Raises DeviceLostError where the camera is silent."""

    def __init__(self, library: Library, camera: int, device: str) -> None:
        self._library, self._camera, self._device = library, camera, device

    def has(self, name: str) -> bool:
        """Whether the camera has the feature, and has it now."""
        try:
            return bool(self._library.call("camera_is_feature_available", self._camera, name.encode()))
        except AravisError as error:
            if error.is_silence:
                raise self._lost() from error
            return False

    def offers(self, name: str, entry: str) -> bool:
        """Whether an enumeration has this entry."""
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

    def write(self, name: str, value: Value) -> None:
        """Have the feature hold ``value``; DeviceConfigurationError where it cannot, or reads back otherwise."""
        kind = type(value)
        if self._holds(name, value):
            return  # a feature in use may be locked against the very value that it holds
        raw = value.encode() if isinstance(value, str) else value
        try:
            self._library.call(f"camera_set_{_KIND[kind]}", self._camera, name.encode(), raw)
        except AravisError as error:
            raise self._refused(name, value, error) from error
        held = self.read(name, kind)
        if not _same(held, value):
            raise DeviceConfigurationError(self._device, name, value, f"it reads back as {held}")

    def _holds(self, name: str, value: Value) -> bool:
        try:
            return self.read(name, type(value)) == value
        except DeviceConfigurationError:  # whatever it holds may be unreadable
            return False

    def execute(self, name: str) -> None:
        try:
            self._library.call("camera_execute_command", self._camera, name.encode())
        except AravisError as error:
            raise self._refused(name, "executed", error) from error

    def integer_range(self, name: str) -> tuple[int, int, int]:
        """Smallest, largest, step."""
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
        """Smallest and largest."""
        low, high = ctypes.c_double(), ctypes.c_double()
        try:
            self._library.call(
                "camera_get_float_bounds", self._camera, name.encode(), ctypes.byref(low), ctypes.byref(high)
            )
        except AravisError as error:
            raise self._refused(name, "asked for its range", error) from error
        return low.value, high.value

    def snap(self, name: str, wanted: int) -> int:
        """The nearest value not above ``wanted`` that the feature takes; the library itself does not check steps."""
        low, high, step = self.integer_range(name)
        return low + (min(max(wanted, low), high) - low) // step * step

    def _refused(self, name: str, wanted: object, error: AravisError) -> DriverError:
        if error.is_silence:
            return self._lost()
        return DeviceConfigurationError(self._device, name, wanted, f"the camera says: {error}")

    def _lost(self) -> DeviceLostError:
        return lost(self._device)


def lost(device: str) -> DeviceLostError:
    """The error of a camera that was there before."""
    return DeviceLostError(device, "does not answer any more; check its cable and power, then close and open it again")


def _same(held: Value, wanted: Value) -> bool:
    if isinstance(wanted, float) and not isinstance(held, str):
        return math.isclose(held, wanted, rel_tol=_FLOAT_STEP, abs_tol=_FLOAT_STEP)
    return held == wanted
