"""Frames that stand at another place than their own are found, and named with their device."""

from __future__ import annotations

import numpy as np
import pytest
from audited_captures import BOTH, audited, exchanged, fatal, replaced, shown_instead, simulated
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simulated_captures import objects_before_wall, only, plate_before_wall

from models.errors import CaptureError
from models.geometry.rig import Side
from models.patterns import make_plan
from service.acquisition.audit import audit
from service.acquisition.finding import Fault

FULL = make_plan("full")
COUNT = len(FULL)
quick = settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])


def expected_device(views: tuple[Side, ...]) -> str:
    return "projector" if len(views) == 2 else f"{views[0]} camera"


VIEWS = pytest.mark.parametrize("views", [("left",), BOTH], ids=["one view", "both views"])


@VIEWS
@pytest.mark.parametrize("first", range(COUNT - 1))
def test_neighbours_exchanged(first: int, views: tuple[Side, ...]) -> None:
    capture = objects_before_wall()
    found = fatal(audited(capture, shown_instead(capture, exchanged(COUNT, first, first + 1), views)))
    assert [(f.fault, f.device, f.index) for f in found] == [
        (Fault.ORDER, expected_device(views), first),
        (Fault.ORDER, expected_device(views), first + 1),
    ]
    assert f"exposure {first} ({FULL.names[first]}) shows {FULL.names[first + 1]}" in found[0].message
    assert f"exposure {first + 1} ({FULL.names[first + 1]}) shows {FULL.names[first]}" in found[1].message
    assert all(f.message.startswith(f.device) for f in found)
    assert found[0].pattern == FULL.names[first]


@quick
@given(st.integers(0, COUNT - 1), st.integers(0, COUNT - 1), st.sampled_from([("right",), BOTH]))
def test_any_two_exchanged(a: int, b: int, views: tuple[Side, ...]) -> None:
    capture = plate_before_wall()
    report = audited(capture, shown_instead(capture, exchanged(COUNT, a, b), views))
    if a == b:
        assert report.ok
        return
    found = fatal(report)
    assert {f.fault for f in found} == {Fault.ORDER}
    assert {f.device for f in found} == {expected_device(views)}
    assert [f.index for f in found] == sorted((a, b))


@quick
@given(st.integers(1, COUNT - 1), st.sampled_from([("left",), BOTH]))
def test_a_frame_delivered_twice(place: int, views: tuple[Side, ...]) -> None:
    capture = objects_before_wall()
    places = list(range(COUNT))
    places[place] = place - 1
    found = fatal(audited(capture, shown_instead(capture, places, views)))
    assert [(f.fault, f.device, f.index) for f in found] == [(Fault.ORDER, expected_device(views), place)]
    assert f"shows {FULL.names[place - 1]}" in found[0].message


@settings(quick, max_examples=6)
@given(st.integers(1, COUNT - 1), st.booleans(), st.sampled_from([("left",), BOTH]))
def test_all_frames_late_or_early_from_one_on(begin: int, late: bool, views: tuple[Side, ...]) -> None:
    """One pulse too many or too few: the rest of the sequence is out by one."""
    capture = objects_before_wall()
    tail = range(begin - 1, COUNT - 1) if late else [*range(begin + 1, COUNT), COUNT - 1]
    places = [*range(begin), *tail]
    report = audited(capture, shown_instead(capture, places, views))
    if places == list(range(COUNT)):
        assert report.ok
        return
    found = fatal(report)
    assert {f.device for f in found} == {expected_device(views)}
    assert found[0].index == begin
    assert f"shows {FULL.names[places[begin]]}" in found[0].message


@VIEWS
@pytest.mark.parametrize("shift", [1, -1])
def test_the_whole_sequence_shifted(shift: int, views: tuple[Side, ...]) -> None:
    capture = objects_before_wall()
    places = [(k - shift) % COUNT for k in range(COUNT)]
    found = fatal(audited(capture, shown_instead(capture, places, views)))
    assert {f.device for f in found} == {expected_device(views)}
    assert found[0].index == 0
    assert "and 29 more" in found[-1].message


def test_a_carrier_that_starts_with_another_step() -> None:
    """Every step fits its neighbours; only the code tells that the fringes begin elsewhere."""
    capture = only(objects_before_wall(), make_plan("reference").kinds)
    names = list(capture.plan.names)
    for turned in ({"high": 1}, {"low": 2}, {"high": 1, "low": 1}):
        places = list(range(len(names)))
        for kind, turn in turned.items():
            members = [k for k, name in enumerate(names) if name.startswith(kind)]
            for position, k in enumerate(members):
                places[k] = members[(position + turn) % len(members)]
        found = fatal(audited(capture, shown_instead(capture, places)))
        assert found, turned
        assert {f.device for f in found} == {"projector"}
        first = min(k for k, place in enumerate(places) if place != k)
        assert found[0].index == first
        assert f"shows {names[places[first]]}" in found[0].message


def test_each_view_with_its_own_fault() -> None:
    capture = objects_before_wall()
    left = shown_instead(capture, exchanged(COUNT, 4, 5), ("left",))["left"]
    right = shown_instead(capture, exchanged(COUNT, 27, 30), ("right",))["right"]
    found = fatal(audited(capture, {"left": left, "right": right}))
    assert {(f.device, f.index) for f in found} == {
        ("left camera", 4),
        ("left camera", 5),
        ("right camera", 27),
        ("right camera", 30),
    }


@pytest.mark.parametrize("plan", ["complementary", "calibration"])
def test_neighbours_of_other_plans(plan) -> None:
    capture = simulated(plan, 31, 2)
    names = capture.plan.names
    for first in range(24, len(names) - 1, 6):
        places = exchanged(len(names), first, first + 1)
        found = fatal(audited(capture, shown_instead(capture, places, ("right",))))
        assert [(f.device, f.index) for f in found] == [("right camera", first), ("right camera", first + 1)], first


def test_a_plane_exchanged_with_its_complement() -> None:
    capture = simulated("complementary", 31, 2)
    names = list(capture.plan.names)
    for bit in (0, 5):
        a, b = names.index(f"gray_{bit:02d}"), names.index(f"gray_inv_{bit:02d}")
        found = fatal(audited(capture, shown_instead(capture, exchanged(len(names), a, b))))
        assert [(f.device, f.index) for f in found] == [("projector", a), ("projector", b)]


def test_a_torn_frame() -> None:
    """From the middle of the image on it shows the next pattern: the camera read out across the change."""
    capture = objects_before_wall()
    torn = capture.images["left"]["low_05"].copy()
    torn[260:] = capture.images["left"]["low_06"][260:]
    found = fatal(audited(capture, replaced(capture, "low_05", {"left": torn})))
    assert [(f.fault, f.device, f.index) for f in found] == [(Fault.ORDER, "left camera", FULL.names.index("low_05"))]


def test_a_frame_of_something_else() -> None:
    capture = objects_before_wall()
    rng = np.random.default_rng(9)
    foreign = rng.integers(0, 120, capture.images["left"]["high_03"].shape).astype(np.uint8)
    found = fatal(audited(capture, replaced(capture, "high_03", {"left": foreign})))
    assert [(f.fault, f.device, f.index) for f in found] == [(Fault.ORDER, "left camera", FULL.names.index("high_03"))]


def test_white_and_black_exchanged_without_fringes() -> None:
    capture = only(objects_before_wall(), {"white", "black"})
    assert audited(capture).ok
    found = fatal(audited(capture, shown_instead(capture, [1, 0])))
    assert {(f.fault, f.device) for f in found} == {(Fault.ORDER, "projector")}


def test_sequences_must_be_whole() -> None:
    capture = objects_before_wall()
    images = {side: dict(by) for side, by in capture.images.items()}
    del images["right"]["low_03"]
    with pytest.raises(CaptureError, match=r"low_03.*missing"):
        audit(images, capture.plan, 255)
    with pytest.raises(CaptureError, match="no images"):
        audit({}, capture.plan, 255)
    images = {side: dict(by) for side, by in capture.images.items()}
    images["left"]["low_03"] = images["left"]["low_03"][:200]
    with pytest.raises(CaptureError, match="size"):
        audit(images, capture.plan, 255)
