"""Whatever is made to go wrong below the drivers is named with device, exposure and reason, and leaves the rig safe."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from bench_rig import Bench

from drivers.camera import CameraState
from drivers.errors import SequenceInvalidError
from drivers.lightcrafter import commands as c
from drivers.projector import ProjectorState
from drivers.virtual.faults import PlantedFault
from models.geometry.rig import SIDES, Side
from service.acquisition.cancellation import CaptureCancelledError
from service.acquisition.finding import Fault, Finding
from service.acquisition.orchestrator import RigNotConnectedError
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest

FULL = CaptureRequest(plan="full")
LEFT, RIGHT, PROJECTOR = "left camera", "right camera", "projector"
Expected = tuple[frozenset[Fault], str, tuple[int, ...] | None]


def _is(*faults: Fault, device: str, at: tuple[int, ...] | None = None) -> Expected:
    """What may be found: one of these kinds, of this device, at one of these exposures."""
    return frozenset(faults), device, at


CASES: list[tuple[PlantedFault, Expected]] = [
    (PlantedFault("dropped", "left", 5), _is(Fault.DROPPED, device=LEFT, at=(5,))),
    (PlantedFault("dropped", "right", 0), _is(Fault.DROPPED, device=RIGHT, at=(0,))),
    (PlantedFault("dropped", "right", 32), _is(Fault.DROPPED, device=RIGHT, at=(32,))),
    (PlantedFault("truncated", "right", 12), _is(Fault.INCOMPLETE, device=RIGHT, at=(12,))),
    (PlantedFault("late", "right", 9), _is(Fault.LATE, device=RIGHT, at=(9,))),
    # the second exposure of a bounced edge keeps the camera busy, so that the next pulse finds it so
    (PlantedFault("doubled", "left", 4), _is(Fault.INTERVAL, Fault.EXTRA, device=LEFT, at=(5,))),
    (PlantedFault("doubled", "right", 32), _is(Fault.EXTRA, device=RIGHT, at=(32,))),
    (PlantedFault("ignored", "left", 7), _is(Fault.IGNORED, device=LEFT, at=(7,))),
    # frames that were on their way when it died are gone as well
    (PlantedFault("dead_camera", "left", 11), _is(Fault.LOST, device=LEFT, at=(9, 10, 11))),
    (PlantedFault("dead_camera", "right", 0), _is(Fault.LOST, device=RIGHT, at=(0,))),
    (PlantedFault("drifted", "right", 3), _is(Fault.SETTINGS, device=RIGHT)),
    (PlantedFault("swapped", None, 6), _is(Fault.ORDER, device=PROJECTOR, at=(6,))),
    (PlantedFault("swapped", "left", 27), _is(Fault.ORDER, device=LEFT, at=(27,))),
    (PlantedFault("dark", None, 0), _is(Fault.DARK, device=PROJECTOR)),
    (PlantedFault("moved", None, 2), _is(Fault.MOTION, device="scene")),
    (PlantedFault("not_started"), _is(Fault.NOT_STARTED, device=PROJECTOR, at=(0,))),
    (PlantedFault("start_refused"), _is(Fault.LOST, device=PROJECTOR)),
    (PlantedFault("unplugged"), _is(Fault.LOST, device=PROJECTOR)),
    # by when it came, its frame is early, one too many, or in the way of the first pulse
    (PlantedFault("early", "left"), _is(Fault.EARLY, Fault.EXTRA, Fault.INTERVAL, device=LEFT)),
]
FOR_EVER = [case for case in CASES if case[0].kind in ("dropped", "truncated", "dead_camera", "swapped", "unplugged")]


def _name(case: object) -> str:
    return f"{case.kind}-{case.side}-{case.index}" if isinstance(case, PlantedFault) else ""


def _named(findings: tuple[Finding, ...], expected: Expected) -> Finding:
    """The finding that was expected; fails with all messages where there is none."""
    kinds, device, at = expected
    fitting = [f for f in findings if f.fault in kinds and f.device == device and (at is None or f.index in at)]
    assert fitting, [f.message for f in findings]
    return fitting[0]


def _refused(bench: Bench, request: CaptureRequest = FULL) -> SequenceRefusedError:
    """A capture that is not kept: refused in one line, with the rig left safe."""
    with pytest.raises(SequenceRefusedError) as caught:
        bench.strict.capture(request)
    assert "\n" not in str(caught.value)
    assert bench.is_safe
    return caught.value


def _is_well(bench: Bench) -> None:
    bench.virtual.mend()
    bench.orchestrator.connect()
    outcome = bench.orchestrator.capture(FULL)
    assert len(outcome.capture.plan) == 33
    assert bench.is_safe


class TestPlantedFaults:
    @pytest.mark.parametrize(("fault", "expected"), CASES, ids=_name)
    def test_once_is_named_and_retaken(self, bench: Bench, fault: PlantedFault, expected: Expected) -> None:
        bench.virtual.plant(fault)
        outcome = bench.orchestrator.capture(FULL)
        assert outcome.attempts >= 2
        finding = _named(outcome.findings, expected)
        assert finding.message.startswith(finding.device)
        assert any(finding.message in warning for warning in outcome.capture.record.warnings)
        assert bench.is_safe

    @pytest.mark.parametrize(("fault", "expected"), FOR_EVER, ids=_name)
    def test_for_ever_is_named_and_refused(self, bench: Bench, fault: PlantedFault, expected: Expected) -> None:
        bench.virtual.plant(replace(fault, sequences=None))
        _named(_refused(bench).findings, expected)
        _is_well(bench)

    def test_saturation_is_refused_at_once(self, bench: Bench) -> None:
        bench.virtual.plant(PlantedFault("saturated", "left"))
        error = _refused(bench)
        _named(error.findings, _is(Fault.SATURATED, device=LEFT))
        assert len(error.findings) == 1


class TestWires:
    @pytest.mark.parametrize("sides", [("left",), ("right",), SIDES], ids=str)
    def test_wrong_polarity(self, bench: Bench, sides: tuple[Side, ...]) -> None:
        """Each frame then shows most of the following pattern, which ids and times cannot tell."""
        bench.virtual.wiring.inverted.update(sides)
        device = PROJECTOR if len(sides) > 1 else f"{sides[0]} camera"
        finding = _named(_refused(bench).findings, _is(Fault.ORDER, device=device))
        assert "shows" in finding.message
        _is_well(bench)

    def test_wrong_polarity_with_one_exposure(self, bench: Bench) -> None:
        bench.virtual.wiring.inverted.update(SIDES)
        error = _refused(bench, CaptureRequest(plan="composite"))
        _named(error.findings, _is(Fault.DARK, device=PROJECTOR))

    @pytest.mark.parametrize("side", SIDES)
    def test_a_cut_wire(self, bench: Bench, side: Side) -> None:
        bench.virtual.wiring.cut.add(side)
        finding = _named(_refused(bench).findings, _is(Fault.NO_TRIGGER, device=f"{side} camera", at=(0,)))
        assert "cable" in finding.message
        _is_well(bench)

    def test_a_trigger_line_that_nothing_is_wired_to(self, bench: Bench) -> None:
        bench.virtual.wiring.cut.update(SIDES)
        _named(_refused(bench).findings, _is(Fault.NOT_STARTED, device=PROJECTOR, at=(0,)))


class TestController:
    @pytest.mark.parametrize(
        "command",
        [c.LUT_CONTROL, c.TIMING, c.PATTERN_ENTRIES, c.VALIDATE, c.RUN, c.MAIN_STATUS, c.LED_CURRENT],
        ids=lambda command: command.name,
    )
    def test_a_refused_command_is_named(self, bench: Bench, command: c.Command[object]) -> None:
        bench.virtual.projector.faults.refused.add(command.name)
        finding = _named(_refused(bench).findings, _is(Fault.LOST, device=PROJECTOR))
        assert command.name in finding.message
        _is_well(bench)

    def test_a_start_that_is_not_answered(self, bench: Bench) -> None:
        """The light may be on then; nobody could tell."""
        bench.virtual.projector.faults.silent.add(c.RUN.name)
        with pytest.raises(SequenceRefusedError) as caught:
            bench.strict.capture(FULL)
        _named(caught.value.findings, _is(Fault.LOST, device=PROJECTOR))
        assert c.RUN.name in str(caught.value)
        _is_well(bench)

    def test_validation_that_never_ends(self, bench: Bench) -> None:
        bench.virtual.projector.faults.stuck_validation = True
        finding = _named(_refused(bench).findings, _is(Fault.LOST, device=PROJECTOR))
        assert "validation" in finding.message
        _is_well(bench)

    def test_a_sequence_that_the_controller_finds_invalid(self, bench: Bench) -> None:
        bench.virtual.projector.faults.validation = 1
        with pytest.raises(SequenceInvalidError, match="exposure or the period"):
            bench.orchestrator.capture(FULL)
        assert bench.is_safe
        _is_well(bench)

    def test_stale_replies_are_told_from_its_own(self, bench: Bench) -> None:
        bench.virtual.projector.faults.stale_replies = 3
        outcome = bench.orchestrator.capture(FULL)
        assert not [finding for finding in outcome.findings if finding.device == PROJECTOR]

    def test_standby_is_named_and_ended(self, bench: Bench) -> None:
        bench.virtual.projector.sleep()
        outcome = bench.orchestrator.capture(FULL)
        assert "standby" in _named(outcome.findings, _is(Fault.LOST, device=PROJECTOR)).message
        assert bench.is_safe

    def test_an_exposure_too_short_for_eight_bits(self, bench: Bench) -> None:
        before = bench.virtual.wiring.pulses_sent
        with pytest.raises(SequenceInvalidError, match=r"'composite'.*4000 us.*8333"):
            bench.orchestrator.capture(CaptureRequest(plan="full", exposure_us=4000))
        assert bench.virtual.wiring.pulses_sent == before
        assert bench.is_safe


class TestCancelling:
    def test_while_the_controller_validates(self, bench: Bench) -> None:
        bench.virtual.projector.faults.stuck_validation = True
        threading.Timer(0.5, bench.orchestrator.cancel).start()
        begun = time.monotonic()
        with pytest.raises(CaptureCancelledError):
            bench.orchestrator.capture(FULL)
        assert time.monotonic() - begun < 2.0
        assert bench.is_safe
        _is_well(bench)

    def test_while_patterns_are_shown(self, bench: Bench) -> None:
        sent = bench.virtual.wiring.pulses_sent
        with ThreadPoolExecutor(1) as pool:
            capturing = pool.submit(bench.orchestrator.capture, FULL)
            deadline = time.monotonic() + 10
            while bench.virtual.wiring.pulses_sent < sent + 3 and time.monotonic() < deadline:
                time.sleep(0.001)
            assert bench.orchestrator.cancel()
            with pytest.raises(CaptureCancelledError):
                capturing.result()
        assert sent + 3 <= bench.virtual.wiring.pulses_sent < sent + 33
        assert bench.is_safe
        _is_well(bench)


class TestUnplugged:
    def test_the_projector(self, bench: Bench) -> None:
        bench.virtual.unplug_projector()
        _named(_refused(bench).findings, _is(Fault.LOST, device=PROJECTOR))
        with pytest.raises(RigNotConnectedError, match="projector: is not attached"):
            bench.strict.capture(FULL)
        bench.virtual.plug_projector()
        assert len(bench.strict.capture(FULL).capture.plan) == 33

    @pytest.mark.parametrize("side", SIDES)
    def test_a_camera(self, bench: Bench, side: Side) -> None:
        bench.virtual.cameras[side].unplug()
        _named(_refused(bench).findings, _is(Fault.LOST, device=f"{side} camera"))
        with pytest.raises(RigNotConnectedError, match=f"{side} camera: no camera answers"):
            bench.strict.capture(FULL)
        bench.virtual.cameras[side].plug()
        assert len(bench.strict.capture(FULL).capture.plan) == 33

    def test_what_is_lost_while_idle_is_noticed_and_found_again(self, bench: Bench) -> None:
        right, projector = bench.devices.right, bench.devices.projector
        bench.orchestrator.look_after()
        assert bench.orchestrator.connected
        bench.virtual.cameras["right"].unplug()
        bench.virtual.unplug_projector()
        bench.orchestrator.look_after()
        assert not bench.orchestrator.connected
        assert {right.state, projector.state} == {CameraState.CLOSED, ProjectorState.CLOSED}
        assert set(bench.orchestrator.failures) == {RIGHT, PROJECTOR}
        bench.virtual.mend()
        bench.orchestrator.look_after()
        assert bench.orchestrator.connected
        assert bench.orchestrator.failures == {}
        assert len(bench.orchestrator.capture(FULL).capture.plan) == 33
