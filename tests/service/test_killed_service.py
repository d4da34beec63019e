"""A service that is killed in the middle of captures leaves a whole library and goes on."""

from __future__ import annotations

import random
from pathlib import Path

from benchmarks.service_kill import kill_at_random

MOMENTS = 3


def test_kills_leave_whole_captures_and_repeats_give_one(recorded: Path, tmp_path: Path) -> None:
    moments = kill_at_random(tmp_path, MOMENTS, random.Random(4), ["--replay", str(recorded)])
    assert len(moments) == MOMENTS
    assert all(moment.found in ("none", "partial", "whole") for moment in moments)
