"""Features of a camera by name: every write is read back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TypeVar

from drivers.errors import DeviceConfigurationError, DeviceLostError

Value = str | float | bool
"""Enumerations and texts are str; integers are int."""
_V = TypeVar("_V", bound="str | float | bool")
_FLOAT_STEP = 0.01
"""A float may be rounded by this share of it, or by this much, to the camera's own steps."""


class Features(ABC):
    """What a driver's library must do with features for the settings in drivers/genicam/settings.py.

    Not safe against threads. Raises DeviceLostError where the camera is silent.
    """

    def __init__(self, device: str) -> None:
        self._device = device

    @abstractmethod
    def has(self, name: str) -> bool:
        """Whether the camera has the feature, and has it now."""

    @abstractmethod
    def offers(self, name: str, entry: str) -> bool:
        """Whether an enumeration has this entry."""

    @abstractmethod
    def read(self, name: str, kind: type[_V]) -> _V:
        """What the camera holds, not what was last written; DeviceConfigurationError where it cannot be read."""

    @abstractmethod
    def execute(self, name: str) -> None:
        """Carry out a command."""

    @abstractmethod
    def integer_range(self, name: str) -> tuple[int, int, int]:
        """Smallest, largest, step."""

    @abstractmethod
    def float_range(self, name: str) -> tuple[float, float]:
        """Smallest and largest."""

    @abstractmethod
    def _set(self, name: str, value: Value) -> None:
        """Write without a look at what it holds."""

    def write(self, name: str, value: Value) -> None:
        """Have the feature hold ``value``; DeviceConfigurationError where it cannot, or reads back otherwise."""
        if self._holds(name, value):
            return  # a feature in use may be locked against the very value that it holds
        self._set(name, value)
        held = self.read(name, type(value))
        if not _same(held, value):
            raise DeviceConfigurationError(self._device, name, value, f"it reads back as {held}")

    def snap(self, name: str, wanted: int) -> int:
        """The nearest value not above ``wanted`` that the feature takes; libraries need not check steps."""
        low, high, step = self.integer_range(name)
        return low + (min(max(wanted, low), high) - low) // step * step

    def first_text(self, *names: str) -> str:
        """The first of these features that the camera has, else nothing."""
        return next((self.read(name, str) for name in names if self.has(name)), "")

    @property
    def serial(self) -> str:
        """Serial number, as the camera itself shows it."""
        return self.first_text("DeviceSerialNumber", "DeviceID")

    def _holds(self, name: str, value: Value) -> bool:
        try:
            return self.read(name, type(value)) == value
        except DeviceConfigurationError:  # whatever it holds may be unreadable
            return False

    def _lost(self) -> DeviceLostError:
        return lost(self._device)


def lost(device: str) -> DeviceLostError:
    """The error of a camera that was there before."""
    return DeviceLostError(device, "does not answer any more; check its cable and power, then close and open it again")


def _same(held: Value, wanted: Value) -> bool:
    if isinstance(wanted, float) and not isinstance(held, str):
        return math.isclose(held, wanted, rel_tol=_FLOAT_STEP, abs_tol=_FLOAT_STEP)
    return held == wanted
