"""``duofringe serve`` as a process of its own, and what the system knows about that process."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import httpx2

PROGRAM = Path(sys.executable).with_name("duofringe")
_START_S = 120.0
_SERVING = re.compile(r"serving on (http://\S+)")


class ServiceProcess:
    """A service on a free port of this computer, with a library in ``folder``; ready when the constructor returns.

    arguments: of ``duofringe serve``. environment: settings, ``DUOFRINGE_...``; others of this process do not count.
    Use it in a with statement, which ends the service at once. Raises RuntimeError when it does not start.
    """

    def __init__(self, folder: Path, arguments: Sequence[str], environment: Mapping[str, str] = {}) -> None:
        self.library = folder / "library"
        self._log_path = folder / f"service-{time.monotonic_ns()}.log"
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("DUOFRINGE_")}
        settings = {"DUOFRINGE_LIBRARY__FOLDER": str(self.library), **environment}
        with self._log_path.open("wb") as log:
            self.process = subprocess.Popen(
                [PROGRAM, "serve", "--port", "0", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**inherited, **settings},
            )
        try:
            self.url = self._wait_until_ready()
        except BaseException:
            self.kill()
            raise

    def _wait_until_ready(self) -> str:
        until = time.monotonic() + _START_S
        while time.monotonic() < until and self.process.poll() is None:
            found = _SERVING.search(self.log)
            if found is not None and "startup complete" in self.log:
                return found[1]
            time.sleep(0.05)
        raise RuntimeError(f"the service did not start: {self.log[-2000:]}")

    @property
    def log(self) -> str:
        """What it wrote so far."""
        return self._log_path.read_text(encoding="utf-8", errors="replace")

    @property
    def threads(self) -> int:
        return len(list(self._proc("task").iterdir()))

    @property
    def descriptors(self) -> list[str]:
        """What its open file descriptors lead to."""
        found = []
        for entry in self._proc("fd").iterdir():
            try:
                found.append(os.readlink(entry))  # noqa: PTH115  # what it names need not be a path
            except FileNotFoundError:
                continue
        return sorted(found)

    @property
    def memory_mib(self) -> float:
        """Resident memory."""
        return self._status("VmRSS")

    @property
    def highest_memory_mib(self) -> float:
        """The most since ``forget_highest_memory``."""
        return self._status("VmHWM")

    def forget_highest_memory(self) -> None:
        self._proc("clear_refs").write_text("5")

    def _proc(self, name: str) -> Path:
        return Path(f"/proc/{self.process.pid}/{name}")

    def _status(self, field: str) -> float:
        lines = self._proc("status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{field}:"))

    def client(self, **options: object) -> httpx2.Client:
        """A client of the service that waits long enough for a reconstruction."""
        return httpx2.Client(base_url=self.url, timeout=120.0, **options)  # type: ignore[arg-type]

    def terminate(self, timeout_s: float = 30.0) -> int:
        """Ask it to end, and return its exit status; negative when a signal ended it."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout_s)

    def kill(self) -> None:
        """End it without a chance to clean up."""
        self.process.kill()
        self.process.wait()

    def __enter__(self) -> ServiceProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()
