"""The program around its commands: help, exit statuses, what goes to which stream."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from models.patterns import LIGHTCRAFTER_4500, PLAN_NAMES, RasterKind, make_pattern
from models.reconstruct import METHODS
from models.stereo.matcher import MATCHINGS
from service.cli import options

COMMANDS = (
    "demo",
    "serve",
    "capture",
    "reconstruct",
    "evaluate",
    "simulate",
    "import",
    "patterns list",
    "patterns export",
    "projector flash",
    "projector rehearse-flash",
    "projector video",
    "projector signal",
    "projector firmware inspect",
    "projector firmware build",
    "bench",
    "doctor",
)
Run = Callable[..., tuple[int, str, str]]


class TestHelp:
    @pytest.mark.parametrize("command", COMMANDS)
    def test_every_command_shows_an_example_that_names_it(self, run: Run, command: str) -> None:
        status, out, _ = run(*command.split(), "--help")
        assert status == 0
        assert f"Example: duofringe {command} " in " ".join(out.split())

    def test_help_does_not_wait_for_the_heavy_libraries(self) -> None:
        check = "import sys, service.cli; sys.exit(','.join({'torch', 'trimesh', 'numba', 'cv2'} & set(sys.modules)))"
        done = subprocess.run([sys.executable, "-c", check], check=False, capture_output=True, text=True)
        assert done.stderr.strip() == ""
        start = time.monotonic()
        subprocess.run([sys.executable, "-c", "from service.cli import main; main(['--help'])"], check=True)
        assert time.monotonic() - start < 2.0  # 0.1 s on a quiet machine

    def test_choices_are_those_of_the_library(self) -> None:
        assert options.METHODS == METHODS
        assert options.MATCHINGS == MATCHINGS
        assert get_args(options.PlanChoice) == PLAN_NAMES
        assert get_args(options.RasterChoice) == get_args(RasterKind)


class TestExitStatus:
    @pytest.mark.parametrize(
        "arguments",
        [
            "bogus",
            "reconstruct",
            "reconstruct c --method fft --output x.ply",
            "reconstruct c --method nstep --output x.foo",
            "reconstruct c --method nstep --output x.ply --depth-range 500 400",
            "reconstruct c --method nstep --output x.ply --depth-range 400 400",
            "reconstruct c --method nstep --output x.ply --depth-range -1 400",
            "reconstruct c --method nstep --output x.ply --depth-range nan 400",
            "reconstruct c --method nstep --output x.ply --depth-range 400 inf",
            "reconstruct c --method nstep --output x.ply --matching both",
            "reconstruct c --method wft --output x.ply --weights sim",
            "evaluate d --methods nstep,fft",
            "evaluate d --methods nstep --matching both",
            "evaluate d --methods nstep --workers 0",
            "simulate --samples 0 --seed 1 --output d",
            "simulate --samples 1 --seed 1 --output d --bits 10",
            "patterns export p --raster hexagon",
            "patterns export p --raster square",
            "patterns export p --plan full,everything",
            "projector firmware build --base b --output o",
            "projector firmware build --base b --output o --plan full --images i",
        ],
    )
    def test_wrong_usage_is_2(self, run: Run, arguments: str) -> None:
        status, out, err = run(*arguments.split())
        assert (status, out) == (2, "")
        assert "Error: " in err
        assert "Traceback" not in err

    @pytest.mark.parametrize(
        ("arguments", "reason"),
        [
            ("reconstruct gone --method nstep --output x.ply", "capture 'gone' is not a folder"),
            ("reconstruct gone --method nstep --output no/x.ply", "folder 'no' does not exist"),
            ("evaluate gone --methods nstep", "dataset 'gone' is not a folder"),
            ("evaluate gone --methods nstep --output no/x.json", "folder 'no' does not exist"),
            ("simulate --samples 1 --seed 1 --output no/d", "folder 'no' does not exist"),
            ("simulate --samples 1 --seed 1 --output d --mesh no.stl", "'no.stl' does not exist"),
            ("import gone --manifest m.toml --output c", "'gone' is not a folder"),
            ("import gone --manifest m.toml --output no/c", "folder 'no' does not exist"),
            ("patterns export no/p", "folder 'no' does not exist"),
            ("demo --output no", "folder 'no' does not exist"),
        ],
    )
    def test_failed_work_is_1_with_one_line(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, reason: str
    ) -> None:
        monkeypatch.chdir(tmp_path)
        status, out, err = run(*arguments.split())
        assert (status, out) == (1, "")
        assert reason in err.splitlines()[-1]
        assert sum(line.startswith("duofringe: ") for line in err.splitlines()) == 1
        assert "Traceback" not in err
        assert list(tmp_path.iterdir()) == []


class TestUnexpectedErrors:
    @pytest.fixture
    def broken(self, monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], None]:
        def breaks(error: BaseException) -> None:
            def fail(*_: Any) -> None:
                raise error

            monkeypatch.setattr("models.patterns.make_plan", fail)

        return breaks

    def test_are_one_line_with_a_hint(self, run: Run, broken: Callable[[BaseException], None]) -> None:
        broken(ZeroDivisionError("division\nby zero"))
        status, _, err = run("patterns", "list")
        assert status == 1
        expected = "duofringe: unexpected ZeroDivisionError: division by zero; run again with --debug and report it\n"
        assert err == expected

    @pytest.mark.parametrize("arguments", [("--debug", "patterns", "list"), ("patterns", "list", "--debug")])
    def test_debug_shows_the_traceback_wherever_it_stands(
        self, run: Run, broken: Callable[[BaseException], None], arguments: tuple[str, ...]
    ) -> None:
        broken(ZeroDivisionError("division by zero"))
        status, _, err = run(*arguments)
        assert status == 1
        assert "Traceback (most recent call last)" in err
        assert "in list_command" in err

    def test_a_full_disk_is_told_plainly(self, run: Run, broken: Callable[[BaseException], None]) -> None:
        broken(OSError(28, "No space left on device", "cloud.ply"))
        assert run("patterns", "list")[::2] == (1, "duofringe: cloud.ply: No space left on device\n")

    def test_an_interrupt_ends_with_130(self, run: Run, broken: Callable[[BaseException], None]) -> None:
        broken(KeyboardInterrupt())
        status, _, err = run("patterns", "list")
        assert status == 130
        assert "Traceback" not in err


class TestPatterns:
    def test_list_names_every_exposure_in_order(self, run: Run) -> None:
        status, out, _ = run("patterns", "list", "--plan", "reference")
        assert status == 0
        assert out.startswith("plan reference: 32 exposures\n")
        assert re.findall(r"^ +\d+  (\w+)", out, re.MULTILINE)[:3] == ["white", "high_00", "high_01"]
        status, out, _ = run("patterns", "list", "--plan", "reference", "--json")
        assert [p["name"] for p in json.loads(out)["patterns"]][-1] == "black"

    @pytest.mark.parametrize("kind", ["square", "diamond"])
    def test_exported_images_show_the_pattern_on_every_mirror(self, run: Run, tmp_path: Path, kind: str) -> None:
        status, out, _ = run(
            "patterns", "export", tmp_path / "p", "--plan", "composite", "--format", "png", "--raster", kind, "--json"
        )
        assert status == 0
        manifest = json.loads((tmp_path / "p" / "manifest.json").read_text())
        assert manifest["raster"] == {"columns": 912, "rows": 1140, "kind": kind}
        assert json.loads(out)["patterns"] == manifest["patterns"]
        (entry,) = manifest["patterns"]
        image = cv2.imread(str(tmp_path / "p" / entry["file"]), cv2.IMREAD_UNCHANGED)
        assert image.shape == (LIGHTCRAFTER_4500.rows, LIGHTCRAFTER_4500.columns)
        assert image.dtype == np.uint8
        row, column = 301, 77
        u = column + (0.5 if kind == "diamond" else 0.0)
        assert image[row, column] == np.rint(make_pattern("composite").evaluate(u, row))

    def test_an_existing_folder_is_left_alone(self, run: Run, tmp_path: Path) -> None:
        (tmp_path / "p").mkdir()
        status, _, err = run("patterns", "export", tmp_path / "p", "--plan", "composite")
        assert status == 1
        assert "exists already" in err
        assert list((tmp_path / "p").iterdir()) == []
