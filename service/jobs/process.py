"""The service's side of a job's own process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from service.jobs.messages import MESSAGES, Message, Unexpected
from service.jobs.order import Order

COMMAND = (
    sys.executable,
    "-P",  # modules that lie in the working folder are none of the program's
    "-c",
    "import sys; sys.path.append(sys.argv[1]); from service.jobs.child import main; main()",
    str(Path(__file__).parents[2]),
)
"""Of a job's process: loads the same program, installed or not, whatever the working folder."""


class JobProcess:
    """A process that carries out an order; killed at any moment, it leaves nothing that could not be gone on from."""

    def __init__(self, order: Order) -> None:
        self._process = subprocess.Popen(
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # a terminal's Ctrl-C is for the service, which ends its job itself
            env={name: value for name, value in os.environ.items() if not name.startswith("DUOFRINGE_")},
        )
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # where it is dead already, which ``ended`` will tell
            self._process.stdin.write(order.model_dump_json().encode() + b"\n")
            self._process.stdin.flush()

    @property
    def pid(self) -> int:
        return self._process.pid

    def messages(self) -> Iterator[Message]:
        """What it tells until it ends, as it comes."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                yield MESSAGES.validate_json(line)
            except ValidationError as error:
                yield Unexpected(trace=f"the job's process said {line[:200]!r}: {error}")

    def kill(self) -> None:
        """End it now."""
        self._process.kill()

    def ended(self) -> str:
        """Wait for its end and tell how it came, for a process that has not told itself."""
        code = self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(BrokenPipeError):  # of what it never read
                    stream.close()
        if code >= 0:
            return f"the job's process ended with status {code}; the service's log may say why"
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return f"the job's process was killed ({name}); out of memory? resume the job, or take fewer captures or pixels"
