"""The compute lane: reconstructions one after the other, in one thread that owns the processors' thread pools.

Every thread that enters torch or numba would bring a pool of its own; one lane keeps their number, and memory, fixed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from models.errors import DuofringeError

T = TypeVar("T")


class ComputeBusyError(DuofringeError):
    """Too many computations wait already."""

    def __init__(self, waiting: int) -> None:
        super().__init__(f"{waiting} computations wait already; try again later")
        self.retry_after_s = 5


class ComputeLane:
    """Runs one computation at a time.

    longest_queue: how many may wait or run. Whoever waits occupies a thread of the server's 40; the rest answer others.
    """

    def __init__(self, longest_queue: int = 16) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="duofringe-compute")
        self._room = threading.BoundedSemaphore(longest_queue)
        self._longest_queue = longest_queue

    def submit(self, work: Callable[[], T]) -> Future[T]:
        """Queue work; raises ComputeBusyError when the queue is full."""
        if not self._room.acquire(blocking=False):
            raise ComputeBusyError(self._longest_queue)
        try:
            future = self._pool.submit(work)
        except BaseException:
            self._room.release()
            raise
        future.add_done_callback(lambda _: self._room.release())
        return future

    def close(self) -> None:
        """Drop what waits and wait for what runs."""
        self._pool.shutdown(wait=True, cancel_futures=True)
