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


class RigLock:
    """A lock that waits briefly instead of hanging a request, and knows what it is held for."""

    def __init__(self, wait_s: float = 0.05) -> None:
        self._lock = threading.Lock()
        self._wait_s = wait_s
        self._holder = ""

    @property
    def holder(self) -> str | None:
        """What the rig is held for, or None."""
        return self._holder or None

    @contextmanager
    def hold(self, purpose: str) -> Iterator[None]:
        """Hold the rig for ``purpose``; raises RigBusyError after the short wait."""
        if not self._lock.acquire(timeout=self._wait_s):
            raise RigBusyError(self._holder or "another request")
        self._holder = purpose
        try:
            yield
        finally:
            self._holder = ""
            self._lock.release()
