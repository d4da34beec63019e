"""``capture`` and ``doctor`` on a rig that replays, and what they say when something is wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.capture import read_capture, write_capture

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def in_its_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


class TestCapture:
    def test_writes_a_capture_that_replays_the_recorded_one(self, run: Run, full_capture: Path, tmp_path: Path) -> None:
        status, out, _ = run("capture", "--plan", "full", "--replay", full_capture, "--output", "scan", "--json")
        assert status == 0
        told = json.loads(out)
        assert told["attempts"] == 1
        assert {device["origin"] for device in told["devices"]} == {"replayed"}
        taken, recorded = read_capture(tmp_path / "scan"), read_capture(full_capture / "plate")
        assert taken.record.id == "scan"
        assert taken.plan.names == recorded.plan.names
        for side in taken.sides:
            for name in taken.plan.names:
                np.testing.assert_array_equal(taken.images[side][name], recorded.images[side][name])

    def test_nothing_is_written_when_it_is_refused(self, run: Run, full_capture: Path, tmp_path: Path) -> None:
        capture = read_capture(full_capture / "plate")
        left = dict(capture.images["left"])
        left["high_03"], left["high_04"] = left["high_04"], left["high_03"]
        capture.images["left"].update(left)  # type: ignore[attr-defined]  # a dict in fact
        (tmp_path / "wrong").mkdir()
        write_capture(capture, tmp_path / "wrong" / "swapped")
        status, out, err = run("capture", "--plan", "reference", "--replay", "wrong", "--output", "scan")
        assert (status, out) == (1, "")
        assert "left camera" in err
        assert "high_04" in err
        assert not (tmp_path / "scan").exists()
        assert not list(tmp_path.glob(".*partial*"))

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (("--plan", "calibration", "--output", "scan"), "row_high"),
            (("--plan", "full", "--output", "no/where"), "does not exist"),
            (("--plan", "full", "--output", "scan", "--scene", "../x"), "../x"),
            (("--plan", "full", "--output", "scan", "--exposure-us", "100"), "white"),
            (("--plan", "full", "--output", "."), "exists already"),
        ],
    )
    def test_what_cannot_be_is_one_line(
        self, run: Run, full_capture: Path, arguments: tuple[str, ...], told: str
    ) -> None:
        status, out, err = run("capture", "--replay", full_capture, *arguments)
        assert (status, out) == (1, "")
        assert told in err.splitlines()[-1]
        assert "Traceback" not in err

    def test_a_rig_that_is_not_there_is_told(self, run: Run) -> None:
        status, _, err = run("capture", "--plan", "composite", "--output", "scan")
        assert status == 1
        assert "no hardware was found" in err


class TestDoctor:
    def test_a_healthy_rig(self, run: Run, full_capture: Path) -> None:
        status, out, _ = run("doctor", "--replay", full_capture, "--json")
        told = json.loads(out)
        assert (status, told["ok"]) == (0, True)
        subjects = {symptom["subject"] for symptom in told["symptoms"]}
        assert {"library", "left camera", "right camera", "projector", "calibration", "test exposure"} <= subjects

    def test_a_missing_rig_is_a_fault_with_its_remedy(self, run: Run) -> None:
        status, out, _ = run("doctor")
        assert status == 1
        assert "FAULT" in out
        assert "mend:" in out

    def test_a_disk_without_room_is_a_fault(
        self, run: Run, full_capture: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("DUOFRINGE_LIBRARY__MINIMUM_FREE_BYTES", str(10**18))
        status, out, _ = run("doctor", "--replay", full_capture)
        assert status == 1
        assert "must stay free" in out
