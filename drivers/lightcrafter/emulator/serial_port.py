"""A serial port with an emulated bridge behind it: one end of a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from contextlib import suppress
from pathlib import Path

from drivers.lightcrafter.emulator.i2c_device import EmulatedBridge

_CHUNK = 4096


class EmulatedSerialPort:
    """Answers on ``path``, a link that stays the same when the bridge is pulled and plugged in again."""

    def __init__(self, bridge: EmulatedBridge, path: Path) -> None:
        self._bridge = bridge
        self.path = path
        self._master = self._slave = -1
        self._wake = (-1, -1)
        self._thread: threading.Thread | None = None
        self.plug()

    def plug(self) -> None:
        """Be there; the thread that answers lives until ``unplug``."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self._wake = os.pipe()
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))
        self._thread = threading.Thread(target=self._serve, name="emulated serial port", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Be gone. Idempotent."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        os.write(self._wake[1], b"x")
        thread.join()
        self.path.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave, *self._wake):
            os.close(descriptor)

    def _serve(self) -> None:
        while True:
            ready, _, _ = select.select([self._master, self._wake[0]], [], [])
            if self._wake[0] in ready:
                return
            with suppress(OSError):  # nobody holds the other end
                answer = self._bridge.feed(os.read(self._master, _CHUNK))
                while answer:
                    answer = answer[os.write(self._master, answer) :]
