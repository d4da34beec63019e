"""Stopping a capture from outside: asked for once, seen at the next step."""

from __future__ import annotations

import threading

from models.errors import DuofringeError


class CaptureCancelledError(DuofringeError):
    """The capture was cancelled; nothing was kept and the rig is safe."""


class Cancellation:
    """A request to stop that the one who works looks at between frames and between steps."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def request(self) -> None:
        """Ask for the stop; from any thread, as often as wished."""
        self._event.set()

    @property
    def requested(self) -> bool:
        return self._event.is_set()

    def raise_if_requested(self) -> None:
        """Raise CaptureCancelledError once the stop was asked for."""
        if self.requested:
            raise CaptureCancelledError("the capture was cancelled")

    def wait(self, seconds: float) -> None:
        """Sleep, but wake at the request and raise CaptureCancelledError."""
        if self._event.wait(seconds):
            self.raise_if_requested()
