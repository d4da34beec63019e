"""How much memory a piece of work takes at its worst moment."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def _status(field: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{field}:"))


@contextmanager
def memory_taken_below(mib: float) -> Iterator[None]:
    """Fail when this process at any moment held more than ``mib`` beyond what it holds now."""
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
    before = _status("VmRSS")
    yield
    taken = _status("VmHWM") - before
    assert taken < mib, f"took {taken:.0f} MiB; at most {mib:g} are allowed"
