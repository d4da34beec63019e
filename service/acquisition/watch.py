"""Somebody who looks after the rig while nobody uses it."""

from __future__ import annotations

import logging
import threading

from service.acquisition.orchestrator import Orchestrator

logger = logging.getLogger("duofringe.service")


class RigWatch:
    """Looks after the devices every ``acquisition.watch_s``, on a thread of its own, until ``close``."""

    def __init__(self, orchestrator: Orchestrator) -> None:
        self._orchestrator = orchestrator
        self._period_s = orchestrator.acquisition.watch_s
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="duofringe-watch", daemon=True)
        if self._period_s > 0:
            self._thread.start()

    def close(self) -> None:
        """Look no more; returns when the last look is over. Idempotent."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(self._period_s):
            try:
                self._orchestrator.look_after()
            except Exception:  # whatever it was, the next cable that is pulled must be noticed
                logger.exception("looking after the devices failed")
