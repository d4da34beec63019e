"""What is said of each count of trigger pulses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.acquisition.wiring import LineCount, WiringCount
from service.diagnosis.symptom import Symptom
from service.diagnosis.wiring import judge

GOOD = LineCount("right camera", 0, 8)


def of_left(stray: int = 0, seen: int = 8, lost: int = 0, failure: str = "") -> Symptom:
    left, right = judge(WiringCount(8, {"left": LineCount("left camera", stray, seen, lost, failure), "right": GOOD}))
    assert (right.state, right.finding) == ("ok", "8 of 8 pulses")
    assert left.subject == "trigger wiring of left camera"
    return left


def test_all_pulses() -> None:
    assert of_left() == Symptom("trigger wiring of left camera", "ok", "8 of 8 pulses")


@pytest.mark.parametrize(
    ("count", "finding", "remedy"),
    [
        ({"seen": 0}, "none of 8", "rig.cameras.left.trigger_line"),
        ({"seen": 11}, "11 of 8", "rig.cameras.left.debounce_us"),
        ({"seen": 5}, "5 of 8", "3.3 V"),
        ({"stray": 3}, "3 while nothing was shown", "ground"),
        ({"stray": 3, "seen": 0}, "3 while nothing was shown", "open input"),
        ({"seen": 2, "failure": "left camera: does not answer"}, "does not answer", "cable and power"),
    ],
)
def test_faults(count: dict[str, int], finding: str, remedy: str) -> None:
    symptom = of_left(**count)  # type: ignore[arg-type]
    assert symptom.state == "fault"
    assert finding in symptom.finding
    assert remedy in symptom.remedy


def test_frames_lost_on_the_way_are_not_the_wire() -> None:
    symptom = of_left(lost=2)
    assert symptom.state == "warning"
    assert "2 frame(s)" in symptom.finding
    assert "usbfs" in symptom.remedy


def test_silence_on_both_sides_is_one_fault() -> None:
    lines = {"left": LineCount("left camera", 0, 0), "right": LineCount("right camera", 0, 0)}
    (symptom,) = judge(WiringCount(8, lines))  # type: ignore[arg-type]
    assert (symptom.state, symptom.finding) == ("fault", "no camera saw any of 8 pulses")
    assert "TRIG_OUT_1" in symptom.remedy


def test_a_projector_that_failed_is_the_fault() -> None:
    (symptom,) = judge(WiringCount(8, {"left": GOOD, "right": GOOD}, "projector: was lost"))
    assert (symptom.state, symptom.finding) == ("fault", "projector: was lost")


@given(counts=st.tuples(*[st.integers(0, 12)] * 3), sent=st.integers(1, 8))
def test_only_a_right_count_is_well(counts: tuple[int, int, int], sent: int) -> None:
    stray, seen, lost = counts
    lines = {"left": LineCount("left camera", *counts), "right": LineCount("right camera", 0, sent)}
    left = next(iter(judge(WiringCount(sent, lines))))  # type: ignore[arg-type]
    assert (left.state == "ok") == (stray == 0 and seen == sent and lost == 0)
    assert bool(left.remedy) == (left.state != "ok")
