"""Interpreter, cores and memory."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator

from service.diagnosis.symptom import Symptom

_LITTLE_MEMORY_BYTES = 2 << 30


def examine_computer() -> Iterator[Symptom]:
    yield Symptom("python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    text = f"{cores} cores, {memory / 1e9:.1f} GB of memory"
    if memory < _LITTLE_MEMORY_BYTES:
        yield Symptom("computer", "warning", text, "a single-shot reconstruction needs about 1 GB; add memory")
    else:
        yield Symptom("computer", "ok", text)
