"""What a command says: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Report = Callable[[str, float], None]
"""Takes the name of the present stage and the share of the work done, 0..1."""
_LEAST_SECONDS_BETWEEN_LINES = 2.0


def note(text: str) -> None:
    """A line for the person at the terminal; stdout stays clean for programs."""
    print(text, file=sys.stderr, flush=True)


def result(data: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print a command's result, as JSON where asked for."""
    print(json.dumps(data, indent=2, allow_nan=False) if as_json else text)


@contextmanager
def progress(title: str) -> Iterator[Report]:
    """A progress bar on a terminal; elsewhere a plain line a stage, so that logs stay readable."""
    if sys.stderr.isatty():
        with _bar(title) as report:
            yield report
    else:
        yield _Lines(title)


class _Lines:
    """Says each new stage once, and the share of a long stage now and then."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.said = ""
        self.time = 0.0

    def __call__(self, stage: str, share: float) -> None:
        now = time.monotonic()
        if stage != self.said or now - self.time > _LEAST_SECONDS_BETWEEN_LINES:
            note(f"{self.title}: {stage} {share:.0%}")
            self.said, self.time = stage, now


@contextmanager
def _bar(title: str) -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn(title), BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)
