"""What every benchmark prints: a table for readers, or JSON with the same figures."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Sequence
from typing import Any

import numba
import torch

THREADS = 2
"""Threads that every timing is stated for."""


def parser(module: str, description: str) -> argparse.ArgumentParser:
    """Argument parser of ``python -m benchmarks.<module>``, with ``--json``."""
    made = argparse.ArgumentParser(prog=f"python -m benchmarks.{module}", description=description)
    made.add_argument("--json", action="store_true", help="print JSON in place of the table")
    return made


def limit_threads(threads: int = THREADS) -> None:
    """Hold torch and numba to a number of threads, or to fewer where the machine has fewer cores."""
    torch.set_num_threads(threads)
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))


def show(title: str, rows: Sequence[Sequence[str]], data: dict[str, Any], *, as_json: bool) -> None:
    """Print a title and rows of cells, headings first; or ``data``, with the machine it was measured on."""
    if as_json:
        machine = {"processor": platform.machine(), "threads": torch.get_num_threads(), "torch": torch.__version__}
        print(json.dumps({**data, "machine": machine}, indent=2))
        return
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    ]
    print("\n".join([title, "", lines[0], "-" * len(lines[0]), *lines[1:]]))
