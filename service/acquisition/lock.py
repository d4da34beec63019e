"""The rig exists once: whoever moves it holds this lock, and others learn at once that it is taken."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from models.errors import DuofringeError


class RigBusyError(DuofringeError):
    """Someone else holds the rig. holder: what for. retry_after_s: when it is worth to ask again."""

    def __init__(self, holder: str, retry_after_s: int = 1) -> None:
        super().__init__(f"the rig is busy ({holder}); try again in {retry_after_s} s")
        self.holder = holder
        self.retry_after_s = retry_after_s


_BACKGROUND_S = 20.0
"""Longest wait for work in the background, which ends with the device that it is at once somebody waits."""


class RigLock:
    """A lock that waits briefly instead of hanging a request, and knows what it is held for."""

    def __init__(self, wait_s: float = 0.05) -> None:
        self._lock = threading.Lock()
        self._wait_s = wait_s
        self._holder = ""
        self._background = False
        self._waiting: set[object] = set()

    @property
    def wanted(self) -> bool:
        """Whether somebody waits for the rig."""
        return bool(self._waiting)

    @property
    def holder(self) -> str | None:
        """What the rig is held for, or None; work in the background does not count."""
        return None if self._background else self._holder or None

    @contextmanager
    def hold(self, purpose: str, *, background: bool = False) -> Iterator[None]:
        """Hold the rig for ``purpose``; raises RigBusyError after the short wait.

        background: give way to everybody else: take the rig only if it is free, and let others wait until it is again.
        """
        taken = self._acquire(0.0 if background else self._wait_s)
        # asked after the short wait: such work may have begun meanwhile
        if not taken and not background and self._background:
            taken = self._acquire(_BACKGROUND_S)
        if not taken:
            raise RigBusyError(self._holder or "another request")
        self._holder, self._background = purpose, background
        try:
            yield
        finally:
            self._holder, self._background = "", False
            self._lock.release()

    def _acquire(self, wait_s: float) -> bool:
        if wait_s <= 0:
            return self._lock.acquire(blocking=False)
        waiter = object()
        self._waiting.add(waiter)
        try:
            return self._lock.acquire(timeout=wait_s)
        finally:
            self._waiting.discard(waiter)
