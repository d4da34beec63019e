"""The long run of the benchmarks, shortened: cameras in a process of their own, the receiver an ordinary user."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

PAIRS = 120
ROOT = Path(__file__).resolve().parents[2]
WITHOUT_RAW_SOCKETS = ("setpriv", "--bounding-set", "-net_raw", "--inh-caps", "-net_raw")
"""With them the library bypasses the receive buffer, which an ordinary user cannot."""


def test_an_ordinary_user_loses_and_mixes_up_nothing(aravis: None) -> None:
    """On a machine that is so busy that the small receive buffer overflows, one of three runs."""
    as_user = WITHOUT_RAW_SOCKETS if os.geteuid() == 0 and shutil.which("setpriv") else ()
    command = (*as_user, sys.executable, "-m", "benchmarks.armed_run", "--json", "--pairs", str(PAIRS))
    for _ in range(3):
        ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
        assert ended.returncode == 0, ended.stderr
        figures = json.loads(ended.stdout)
        assert figures["pairs"] == PAIRS
        assert figures["mispaired"] == figures["extra"] == 0
        lost = figures["lost_left"] + figures["lost_right"]
        if lost == 0:
            return
    raise AssertionError(f"the last run lost {lost} frames")
