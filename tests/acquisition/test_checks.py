"""What ids, clocks and settings tell of a sequence, for any frame that any fault strikes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import AppliedSettings, CameraSettings, Frame, StreamStatistics
from drivers.projector import LoadedSequence, ProjectorSettings
from models.patterns import make_plan
from service.acquisition.checks import check_sequence
from service.acquisition.configuring import lit_us
from service.acquisition.finding import Fault
from service.acquisition.recorded import RecordedSequence, RigSettings, View

PLAN = make_plan("full")
PERIOD_US = 10_000.0
APPLIED = AppliedSettings(8333.0, 0.0, 8, 255, (4, 3), {"gamma": "off"})
INDICES = st.integers(0, len(PLAN) - 1)
SIDES = st.sampled_from(["left", "right"])


def _frames(side: str) -> list[Frame]:
    offset = 7_000_000_000 if side == "left" else -3_000_000_000
    return [
        Frame(
            np.zeros((3, 4), np.uint8),
            k,
            offset + round(1000 * PERIOD_US * k),
            1_000_000 + round(1000 * (PERIOD_US * k + 12_000)),
            APPLIED.exposure_us,
            APPLIED.gain_db,
        )
        for k in range(len(PLAN))
    ]


def _view(side: str, frames: Sequence[Frame], **changes: object) -> View:
    view = View(f"{side} camera", tuple(frames), {}, None, APPLIED, APPLIED, StreamStatistics(len(frames)), 0)
    return replace(view, **changes)  # type: ignore[arg-type]


def _sequence(**views: View) -> RecordedSequence:
    pulses = tuple(PERIOD_US * k for k in range(len(PLAN)))
    both = {side: views.get(side) or _view(side, _frames(side)) for side in ("left", "right")}
    loaded = LoadedSequence(PLAN, pulses, PERIOD_US * len(PLAN))
    return RecordedSequence(loaded, both, 1_000_000, 0, ProjectorSettings())  # type: ignore[arg-type]


def test_a_good_sequence_has_no_findings() -> None:
    assert check_sequence(_sequence()) == ()


@given(SIDES, INDICES)
def test_a_frame_lost_on_the_way_is_named(side: str, index: int) -> None:
    frames = [frame for frame in _frames(side) if frame.frame_id != index]
    findings = check_sequence(_sequence(**{side: _view(side, frames)}))
    assert [(f.fault, f.device, f.index) for f in findings] == [(Fault.DROPPED, f"{side} camera", index)]


@given(SIDES, st.integers(1, len(PLAN) - 2))
def test_an_ignored_pulse_is_named_by_the_gap_it_leaves(side: str, index: int) -> None:
    frames = [frame for frame in _frames(side) if frame.frame_id != index]
    renumbered = [replace(frame, frame_id=k) for k, frame in enumerate(frames)]
    findings = check_sequence(_sequence(**{side: _view(side, renumbered)}))
    assert [(f.fault, f.device, f.index) for f in findings] == [(Fault.IGNORED, f"{side} camera", index)]


@given(SIDES, st.integers(0, len(PLAN) - 2))
def test_a_doubled_pulse_is_named(side: str, index: int) -> None:
    frames = _frames(side)
    twin = replace(frames[index], device_ns=frames[index].device_ns + 300_000, host_ns=frames[index].host_ns + 300_000)
    shifted = [*frames[: index + 1], twin, *frames[index + 1 :]]
    numbered = [replace(frame, frame_id=k) for k, frame in enumerate(shifted)][: len(PLAN)]
    statistics = StreamStatistics(len(PLAN), unclaimed=1)
    findings = check_sequence(_sequence(**{side: _view(side, numbered, statistics=statistics)}))
    assert findings[0].fault is Fault.EXTRA
    assert (findings[0].device, findings[0].index) == (f"{side} camera", index + 1)


@given(SIDES, INDICES, st.integers(600_000, 9_000_000))
def test_a_pulse_out_of_time_is_found(side: str, index: int, off_ns: int) -> None:
    frames = _frames(side)
    frames[index] = replace(frames[index], device_ns=frames[index].device_ns + off_ns)
    findings = check_sequence(_sequence(**{side: _view(side, frames)}))
    assert {f.fault for f in findings} == {Fault.INTERVAL}
    assert findings[0].index in (index, index + 1)


@given(st.floats(-100, 100))
def test_clocks_may_drift_and_jitter_within_their_resolution(ppm: float) -> None:
    rng = np.random.default_rng(round(1000 * abs(ppm)))
    frames = [
        replace(f, device_ns=f.device_ns + round(1000 * PERIOD_US * k * ppm * 1e-6 + rng.uniform(-1e5, 1e5)))
        for k, f in enumerate(_frames("right"))
    ]
    assert check_sequence(_sequence(right=_view("right", frames))) == ()


@given(SIDES, INDICES)
def test_a_frame_held_up_is_named(side: str, index: int) -> None:
    frames = _frames(side)
    frames[index] = replace(frames[index], host_ns=frames[index].host_ns + 400_000_000)
    findings = check_sequence(_sequence(**{side: _view(side, frames)}))
    assert [(f.fault, f.device, f.index) for f in findings] == [(Fault.LATE, f"{side} camera", index)]


@given(SIDES, INDICES)
def test_a_damaged_frame_is_named(side: str, index: int) -> None:
    frames = [frame for frame in _frames(side) if frame.frame_id != index]
    findings = check_sequence(_sequence(**{side: _view(side, frames, incomplete={index: "missing packets"})}))
    assert [(f.fault, f.device, f.index) for f in findings] == [(Fault.INCOMPLETE, f"{side} camera", index)]


@given(SIDES)
def test_settings_that_changed_by_themselves_are_named(side: str) -> None:
    after = replace(APPLIED, features={"gamma": "on"})
    findings = check_sequence(_sequence(**{side: _view(side, _frames(side), after=after)}))
    assert [(f.fault, f.device) for f in findings] == [(Fault.SETTINGS, f"{side} camera")]
    assert "gamma" in findings[0].message


def test_one_camera_without_frames_is_its_own_fault_and_both_the_projectors() -> None:
    silent = _view("left", ())
    assert [(f.fault, f.device) for f in check_sequence(_sequence(left=silent))] == [(Fault.NO_TRIGGER, "left camera")]
    both = check_sequence(_sequence(left=silent, right=_view("right", ())))
    assert [(f.fault, f.device) for f in both] == [(Fault.NOT_STARTED, "projector")]


@given(
    st.floats(8333, 300_000),
    st.floats(8333, 300_000),
    st.floats(-0.0009, 0.0009),
)
def test_what_a_cameras_steps_take_off_does_not_shorten_the_patterns(left: float, right: float, step: float) -> None:
    asked = RigSettings({"left": CameraSettings(exposure_us=left), "right": CameraSettings(exposure_us=right)})
    applied = {side: replace(APPLIED, exposure_us=s.exposure_us * (1 + step)) for side, s in asked.cameras.items()}
    assert lit_us(asked, applied) == min(left, right)


def test_an_exposure_that_is_held_to_a_limit_shortens_the_patterns() -> None:
    asked = RigSettings({"left": CameraSettings(exposure_us=50_000), "right": CameraSettings(exposure_us=60_000)})
    applied = {"left": replace(APPLIED, exposure_us=40_000.0), "right": replace(APPLIED, exposure_us=60_000.0)}
    assert lit_us(asked, applied) == 40_000  # type: ignore[arg-type]
