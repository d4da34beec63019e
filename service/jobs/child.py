"""A job's own process, with its order as one line on standard input.

It ends when its standard input does, so it never outlives the service, however that ends. Signals that a terminal or a
service manager sends to all processes at once are left to the service.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:  # what takes long to load waits until signals are ignored
    from pydantic import BaseModel

_NICENESS = 10


def main() -> None:
    """Carry out one order, and tell of it on standard output."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    os.nice(_NICENESS)  # captures and reconstructions go before
    messages = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no message
    line = sys.stdin.buffer.readline()
    threading.Thread(target=_end_with_the_service, daemon=True).start()
    _tell(messages, _work(line, messages))


def _end_with_the_service() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def _work(line: bytes, messages: BinaryIO) -> BaseModel:
    from models.errors import DuofringeError
    from service.jobs.messages import Failed, Finished, Stage, Unexpected
    from service.jobs.order import Order
    from service.jobs.work import run_evaluation, run_training

    order = Order.model_validate_json(line)

    def report(text: str, share: float) -> None:
        _tell(messages, Stage(text=order.public(text), share=min(max(share, 0.0), 1.0)))

    run = run_training if order.kind == "training" else run_evaluation
    try:
        return Finished(result=run(order, report))
    except DuofringeError as error:
        return Failed(reason=_line(order.public(str(error))))
    except OSError as error:
        said = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        return Failed(reason=_line(order.public(said)))
    except Exception:  # noqa: BLE001  # the last door: the service writes it to its log
        return Unexpected(trace=traceback.format_exc())


def _line(text: str) -> str:
    return " ".join(text.split())


def _tell(messages: BinaryIO, message: BaseModel) -> None:
    messages.write(message.model_dump_json().encode("utf-8", "replace") + b"\n")
    messages.flush()
