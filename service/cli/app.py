"""The program: its commands, and how each way of failing ends."""

from __future__ import annotations

import signal
import sys
import traceback
from types import FrameType
from typing import Annotated

import typer

from models.errors import DuofringeError
from service.cli import console
from service.cli.bench import register as register_bench
from service.cli.capture import register as register_capture
from service.cli.demo import register as register_demo
from service.cli.doctor import register as register_doctor
from service.cli.evaluate import register as register_evaluate
from service.cli.import_set import register as register_import
from service.cli.patterns import register as register_patterns
from service.cli.projector import register as register_projector
from service.cli.reconstruct import register as register_reconstruct
from service.cli.serve import register as register_serve
from service.cli.simulate import register as register_simulate
from service.cli.train import register as register_train

FAILED = 1
_DEBUG = "--debug"

app = typer.Typer(
    name="duofringe",
    help="Structured-light captures: take, serve, simulate, import, reconstruct, evaluate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(epilog="Every command has its own --help with an example. Exit status: 0 done, 1 failed, 2 wrong usage.")
def _common(
    context: typer.Context,
    debug: Annotated[bool, typer.Option(_DEBUG, help="Show the traceback of an error; taken anywhere.")] = False,
) -> None:
    context.obj = {"debug": debug}


for register in (
    register_demo,
    register_serve,
    register_capture,
    register_reconstruct,
    register_evaluate,
    register_simulate,
    register_train,
    register_import,
    register_patterns,
    register_projector,
    register_bench,
    register_doctor,
):
    register(app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 the work failed (one line on stderr), 2 usage, 130 interrupted."""
    if arguments is None:
        signal.signal(signal.SIGTERM, _end)
    words = sys.argv[1:] if arguments is None else arguments
    debug = _DEBUG in words
    if debug:
        words = [_DEBUG, *(word for word in words if word != _DEBUG)]
    try:
        app(words, prog_name="duofringe")
    except DuofringeError as error:
        _fail(str(error), error, debug=debug)
    except OSError as error:
        _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error), error, debug=debug)
    except Exception as error:  # noqa: BLE001  # the last door: no traceback reaches a user
        hint = "" if debug else f"; run again with {_DEBUG} and report it"
        _fail(f"unexpected {type(error).__name__}: {error}{hint}", error, debug=debug)


def _end(number: int, _: FrameType | None) -> None:
    """By way of an exception, so that every device is left as after any other end."""
    raise SystemExit(128 + number)


def _fail(text: str, error: Exception, *, debug: bool) -> None:
    if debug:
        traceback.print_exception(error)
    console.note(f"duofringe: {' '.join(text.split())}")
    raise SystemExit(FAILED)
