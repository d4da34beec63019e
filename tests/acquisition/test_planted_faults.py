"""Every planted fault is named with device and exposure, retaken or refused, and leaves the rig safe."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_rig import RecordedRig, recorded_rig

from drivers.virtual.faults import PlantedFault
from models.capture import read_capture
from service.acquisition.finding import Fault
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest

FULL = CaptureRequest(plan="full")
LEFT, RIGHT, PROJECTOR = "left camera", "right camera", "projector"
CASES = [
    (PlantedFault("dropped", "left", 5), Fault.DROPPED, LEFT, 5),
    (PlantedFault("dropped", "right", 0), Fault.DROPPED, RIGHT, 0),
    (PlantedFault("dropped", "right", 32), Fault.DROPPED, RIGHT, 32),
    (PlantedFault("ignored", "left", 7), Fault.IGNORED, LEFT, 7),
    (PlantedFault("late", "right", 9), Fault.LATE, RIGHT, 9),
    (PlantedFault("doubled", "left", 4), Fault.EXTRA, LEFT, 5),
    (PlantedFault("doubled", "right", 31), Fault.EXTRA, RIGHT, 32),
    (PlantedFault("swapped", None, 6), Fault.ORDER, PROJECTOR, 6),
    (PlantedFault("swapped", "left", 27), Fault.ORDER, LEFT, 27),
    (PlantedFault("truncated", "right", 12), Fault.INCOMPLETE, RIGHT, 12),
    (PlantedFault("dead_camera", "left", 11), Fault.LOST, LEFT, 11),
    (PlantedFault("dead_camera", "right", 0), Fault.LOST, RIGHT, 0),
    (PlantedFault("drifted", "right", 3), Fault.SETTINGS, RIGHT, None),
    (PlantedFault("saturated", "left", 0), Fault.SATURATED, LEFT, None),
    (PlantedFault("dark", None, 0), Fault.DARK, PROJECTOR, None),
    (PlantedFault("not_started"), Fault.NOT_STARTED, PROJECTOR, 0),
    (PlantedFault("start_refused"), Fault.LOST, PROJECTOR, None),
    (PlantedFault("unplugged"), Fault.LOST, PROJECTOR, None),
    (PlantedFault("early", "left"), Fault.EARLY, LEFT, 0),
    (PlantedFault("moved", None, 2), Fault.MOTION, "scene", None),
]
REFUSED_AT_ONCE = [case for case in CASES if case[1] is Fault.SATURATED]
"""Another attempt under the same settings would show the same."""


@pytest.fixture(scope="module")
def rig(full_capture: Path) -> Iterator[RecordedRig]:
    """One rig for all, so that each fault also has to leave it usable."""
    rig = recorded_rig(full_capture, retakes=1)
    yield rig
    rig.orchestrator.close()


@pytest.fixture(autouse=True)
def no_faults_left(rig: RecordedRig) -> Iterator[None]:
    """What one test leaves must not fail the next."""
    yield
    rig.bench.clear_faults()


def _name(case: object) -> str:
    return f"{case.kind}-{case.side}-{case.index}" if isinstance(case, PlantedFault) else ""


class TestEveryFault:
    @pytest.mark.parametrize(
        ("fault", "kind", "device", "index"), [case for case in CASES if case not in REFUSED_AT_ONCE], ids=_name
    )
    def test_once_is_retaken(
        self, rig: RecordedRig, full_capture: Path, fault: PlantedFault, kind: Fault, device: str, index: int | None
    ) -> None:
        """The capture that is kept after it holds the recorded images bit for bit, and says what happened."""
        rig.bench.plant(fault)
        outcome = rig.orchestrator.capture(FULL)
        assert outcome.attempts == 2
        named = [f for f in outcome.findings if f.fault is kind and f.device == device]
        assert named, [f.message for f in outcome.findings]
        assert index is None or named[0].index == index
        assert any(named[0].message in warning for warning in outcome.capture.record.warnings)
        recorded = read_capture(full_capture / "plate")
        for side in recorded.sides:
            for name in recorded.plan.names:
                np.testing.assert_array_equal(outcome.capture.images[side][name], recorded.images[side][name])
        assert rig.is_safe

    @pytest.mark.parametrize(("fault", "kind", "device", "index"), CASES, ids=_name)
    def test_for_ever_is_refused(
        self, rig: RecordedRig, fault: PlantedFault, kind: Fault, device: str, index: int | None
    ) -> None:
        rig.bench.plant(replace(fault, sequences=None))
        with pytest.raises(SequenceRefusedError) as caught:
            rig.orchestrator.capture(FULL)
        named = [f for f in caught.value.findings if f.fault is kind and f.device == device]
        assert named, [f.message for f in caught.value.findings]
        assert index is None or named[0].index == index
        assert "\n" not in str(caught.value)
        assert device.split()[0] in str(caught.value)
        assert rig.is_safe
        rig.bench.clear_faults()
        assert rig.orchestrator.capture(FULL).attempts == 1
