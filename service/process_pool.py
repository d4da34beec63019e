"""Work shared between processes, in which a killed worker is an error that names its item."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TypeVar

from models.errors import DuofringeError

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkerKilledError(DuofringeError):
    """A worker process ended without a word: killed from outside, mostly for want of memory."""


def map_in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int, *, name: Callable[[Item], str] = str
) -> Iterator[tuple[Item, Result]]:
    """Pairs of item and result, as they come. One worker, or one item, means this process.

    function and items must be picklable. name: what an item is called in errors. An exception of ``function`` ends the
    work and is raised here; WorkerKilledError when a worker dies.
    """
    if workers == 1 or len(items) == 1:
        for item in items:
            yield item, function(item)
        return
    waiting = list(reversed(items))
    running: dict[Future[Result], Item] = {}
    # Spawned, not forked: a fork of a process that has started torch's threads can hang.
    with ProcessPoolExecutor(workers, get_context("spawn"), _share_cores, (workers,)) as pool:
        try:
            while waiting or running:
                # No more than one item a worker is handed out, so that a death can be put down to few items.
                while waiting and len(running) < workers:
                    item = waiting.pop()
                    running[pool.submit(function, item)] = item
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    yield running.pop(future), result
        except BrokenProcessPool as error:
            suspects = " or ".join(name(item) for item in running.values())
            raise WorkerKilledError(
                f"a worker process was killed at {suspects}; out of memory? use fewer --workers"
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


def _share_cores(workers: int) -> None:
    """Keep the threads of all workers together to the number of cores."""
    import numba
    import torch

    threads = max(1, (os.cpu_count() or 1) // workers)
    torch.set_num_threads(threads)
    numba.set_num_threads(threads)
