"""``duofringe evaluate`` on a tiny simulated set: classes, regions, differences, pictures, Markdown."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from small_rig import DEPTH_RANGE, small_rig

from drivers.simulator.materials import Material
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import cuboid
from models.capture import read_capture, write_capture
from models.dataset import open_dataset
from models.errors import DatasetError, ReconstructionError
from models.patterns import make_plan
from models.reconstruct import ReconstructionOptions
from service import sample_evaluation
from service.evaluation import Evaluation, Summary, by_class, evaluate
from service.evaluation_report import report_markdown, report_text
from service.sample_evaluation import EvaluationOptions, MethodChoice, SampleResult

Run = Callable[..., tuple[int, str, str]]
NSTEP = MethodChoice("nstep")
DEPTHS = ("--depth-range", *(str(bound) for bound in DEPTH_RANGE))


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small plate before a wall; one is told to be dark, and one has no traits, as a recorded capture would be."""
    folder = tmp_path_factory.mktemp("captures")
    wall = SceneObject("wall", cuboid((900.0, 900.0, 2.0), (0.0, 0.0, 601.0)), Material(albedo=0.5))
    for seed, (name, traits) in enumerate({"a": ["wall"], "b": ["dark", "wall"], "c": None}.items(), 5):
        shape = cuboid((45.0, 25.0, 2.0), (2.0 * seed - 10.0, 0.0, 461.0))
        scene = Scene((SceneObject("plate", shape, Material(albedo=0.6)),), wall)
        capture = small_rig().render(scene, make_plan("full"), seed)
        record = capture.record.model_copy(update={"settings": {"traits": traits}, "id": name})
        write_capture(replace(capture, record=record), folder / name)
    return folder


@pytest.fixture(scope="module")
def report(captures: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What one run of the command printed and wrote, by name."""
    from service.cli import main

    folder = tmp_path_factory.mktemp("report")
    (folder / "pictures").mkdir()
    files = ("--output", folder / "e.json", "--markdown", folder / "e.md", "--pictures", folder / "pictures")
    methods = ("--methods", "wft,nstep", "--against", "nstep wrapped", "--picture-samples", "b")
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in ("evaluate", captures, *methods, *DEPTHS, *files)])
    assert not ended.value.code
    return {
        "json": json.loads((folder / "e.json").read_text()),
        "markdown": (folder / "e.md").read_text(),
        "pictures": folder / "pictures",
    }


class TestFigures:
    def test_scenes_are_told_by_class(self, report: dict[str, Any]) -> None:
        classes = report["json"]["classes"]
        assert list(classes) == ["smooth", "dark", "boundaries", "interior"]
        samples = {name: told["rows"]["wft"]["samples"] for name, told in classes.items()}
        assert samples == {"smooth": 1, "dark": 1, "boundaries": 3, "interior": 3}
        by_sample = {sample["sample"]: sample for sample in report["json"]["samples"]}
        assert [by_sample[name]["traits"] for name in "abc"] == [["wall"], ["dark", "wall"], None]
        assert classes["dark"]["title"] == "dark"
        for row, figures in classes["dark"]["rows"].items():
            assert figures["rmse_depth"] == by_sample["b"]["rows"][row]["rmse_depth"]

    def test_the_regions_make_up_the_whole(self, report: dict[str, Any]) -> None:
        for holder, key in [(report["json"], "classes"), *((s, "regions") for s in report["json"]["samples"])]:
            parts = [holder[key][name] for name in ("boundaries", "interior")]
            for row, whole in holder["rows"].items():
                near, rest = (part.get("rows", part)[row] for part in parts)
                assert 0 < near["pixels"] < rest["pixels"]
                assert near["pixels"] + rest["pixels"] == whole["pixels"]
                valid = near["pixels"] * near["valid"] + rest["pixels"] * rest["valid"]
                assert valid == pytest.approx(whole["pixels"] * whole["valid"])
        rows = report["json"]["classes"]["boundaries"]["rows"]
        assert rows["wft"]["valid"] < report["json"]["rows"]["wft"]["valid"]

    def test_differences_are_those_of_the_figures(self, report: dict[str, Any]) -> None:
        data = report["json"]
        told = data["differences"]
        assert told["against"] == "nstep wrapped"
        assert set(told["rows"]) == {"wft", "nstep"}
        for differences, rows in [
            (told["rows"], data["rows"]),
            *((told["classes"][name], data["classes"][name]["rows"]) for name in told["classes"]),
        ]:
            for row, by_figure in differences.items():
                for figure in ("valid", "mae_depth", "within_1mm"):
                    expected = rows[row][figure] - rows["nstep wrapped"][figure]
                    assert by_figure[figure]["difference"] == pytest.approx(expected)
        accuracy = told["rows"]["wft"]["valid"]
        low, high = accuracy["interval"]
        assert low <= accuracy["difference"] <= high
        assert accuracy["excludes_zero"] == (low > 0 or high < 0)

    def test_what_was_there_before_is_there_still(self, report: dict[str, Any]) -> None:
        data = report["json"]
        assert data["schema"] == "evaluation/1"
        assert data["methods"] == ["wft", "nstep"]
        assert list(data["rows"]) == ["wft", "nstep", "nstep wrapped"]
        assert {"intervals", "timings_s", "valid", "pixels"} <= set(data["rows"]["wft"])
        assert {"sample", "object_id", "truth", "rows", "timings_s", "failures"} <= set(data["samples"][0])


class TestMarkdown:
    def test_it_has_the_command_and_all_tables(self, report: dict[str, Any], captures: Path) -> None:
        text = report["markdown"]
        command = f"duofringe evaluate {captures} --split test --methods wft,nstep --depth-range 400 670 "
        assert command + "--against 'nstep wrapped'\n" in text
        assert f"Dataset `{captures}`, split `test`, 3 samples." in text
        headings = [line for line in text.splitlines() if line.startswith("## ")]
        assert headings == [
            "## Whole split",
            "## By class and region",
            "## Differences to `nstep wrapped`",
            "## Time",
        ]
        tables = [block.splitlines() for block in text.split("\n\n") if block.startswith("| ")]
        assert len(tables) == 5
        for table in tables:
            assert len({line.replace("\\|", "").count("|") for line in table}) == 1

    def test_its_figures_are_those_of_the_json(self, report: dict[str, Any]) -> None:
        figures = report["json"]["rows"]["wft"]
        row = next(line for line in report["markdown"].splitlines() if line.startswith("| wft |"))
        assert row.split(" | ")[1] == f"{figures['valid']:.2f}"


class TestPictures:
    def test_the_chosen_sample_is_drawn_with_a_row_a_method(self, report: dict[str, Any]) -> None:
        (path,) = report["pictures"].iterdir()
        assert path.name == "b.png"
        picture = cv2.imread(str(path))
        height, width = picture.shape[:2]
        assert width > 1600
        assert height > 4 * 200  # truth and three methods, panels twice as wide as high
        pink = (picture == (214, 84, 250)).all(axis=2)
        assert pink.any()  # a foreground pixel that a method missed
        green = np.abs(picture.astype(int) - (96, 220, 40)).sum(axis=2) < 30
        assert green[:, -500:].any()
        assert not green[:, : width // 2].any()

    def test_the_first_four_are_drawn_by_default(self, captures: Path, tmp_path: Path) -> None:
        options = EvaluationOptions((NSTEP,), depth_range=DEPTH_RANGE, pictures=tmp_path)
        evaluate(open_dataset(captures / "a"), "all", options)
        assert [path.name for path in tmp_path.iterdir()] == ["a.png"]

    def test_a_failed_method_is_drawn_as_nothing(
        self, captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fails(*_: Any, **__: Any) -> None:
            raise ReconstructionError("too dark")

        monkeypatch.setattr(sample_evaluation, "reconstruct", fails)
        options = EvaluationOptions((NSTEP,), depth_range=DEPTH_RANGE, pictures=tmp_path)
        evaluate(open_dataset(captures / "a"), "all", options)
        assert (tmp_path / "a.png").is_file()


class TestMistakes:
    @pytest.mark.parametrize(
        ("arguments", "reason"),
        [
            ("--methods fft", "'fft' is not one of nstep"),
            ("--methods wft:x", "method wft has no weights; write wft"),
            ("--methods wft --against shearlet", "'shearlet' is not one of wft, nstep wrapped, nstep"),
            ("--methods wft --picture-samples a", "needs --pictures FOLDER"),
        ],
    )
    def test_wrong_usage(self, run: Run, arguments: str, reason: str) -> None:
        status, _, err = run("evaluate", "gone", *arguments.split())
        assert status == 2
        assert reason in " ".join(err.replace("│", " ").split())

    def test_folders_and_samples_that_are_not_there(self, run: Run, captures: Path, tmp_path: Path) -> None:
        for arguments, reason in (
            (("--pictures", tmp_path / "no"), f"picture folder '{tmp_path / 'no'}' does not exist"),
            (("--markdown", tmp_path / "no" / "e.md"), f"output folder '{tmp_path / 'no'}' does not exist"),
            (("--pictures", tmp_path, "--picture-samples", "a,z"), "split 'test' has no sample 'z' to draw"),
        ):
            status, out, err = run("evaluate", captures, "--methods", "nstep", *arguments)
            assert (status, out) == (1, "")
            assert reason in err.splitlines()[-1]
        assert list(tmp_path.iterdir()) == []

    def test_a_row_that_no_sample_has_is_told(self, run: Run, captures: Path, tmp_path: Path) -> None:
        write_capture(read_capture(captures / "a", kinds={"composite"}), tmp_path / "single")
        arguments = ("--methods", "wft", "--against", "nstep", *DEPTHS, "--json")
        status, out, err = run("evaluate", tmp_path / "single", *arguments)
        assert status == 0
        assert "warning: no sample has 'nstep' and another row" in err
        assert json.loads(out)["differences"]["rows"] == {}

    def test_a_row_to_compare_with_must_be_one_of_the_rows(self, captures: Path) -> None:
        with pytest.raises(DatasetError, match="no row 'x' to compare with; the rows are nstep, nstep wrapped"):
            evaluate(open_dataset(captures), "all", EvaluationOptions((NSTEP,)), against="x")


class TestMethodChoice:
    @pytest.fixture(autouse=True)
    def learned(self, monkeypatch: pytest.MonkeyPatch) -> None:
        known = dict.fromkeys([*sample_evaluation.METHODS, "refiner"])
        monkeypatch.setattr(sample_evaluation, "METHODS", tuple(known))

    @pytest.mark.parametrize("text", ["wft", "refiner", "refiner:a3", "refiner:/some/folder:v2"])
    def test_the_label_is_the_text(self, text: str) -> None:
        assert MethodChoice.parse(f" {text} ").label == text

    def test_weights_are_what_follows_the_first_colon(self) -> None:
        assert MethodChoice.parse("refiner:/some/folder:v2") == MethodChoice("refiner", "/some/folder:v2")
        assert MethodChoice.parse("refiner").weights is None

    @pytest.mark.parametrize("text", ["", ":a3", "fft", "nstep:a3", "refiner:"])
    def test_others_are_refused_by_name(self, text: str) -> None:
        with pytest.raises(ReconstructionError, match=f"'{text.partition(':')[0]}"):
            MethodChoice.parse(text)

    def test_the_reconstruction_takes_the_chosen_weights(self, captures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        taken = []

        def notes(_: Any, options: ReconstructionOptions, **__: Any) -> None:
            taken.append((options.method, options.weights))
            raise ReconstructionError("noted")

        monkeypatch.setattr(sample_evaluation, "reconstruct", notes)
        choices = tuple(MethodChoice.parse(text) for text in ("refiner", "refiner:a3", "wft"))
        evaluate(open_dataset(captures / "a"), "all", EvaluationOptions(choices, depth_range=DEPTH_RANGE))
        assert taken[:3] == [("refiner", None), ("refiner", "a3"), ("wft", None)]

    def test_weights_side_by_side_have_rows_of_their_own(self) -> None:
        choices = tuple(MethodChoice.parse(text) for text in ("refiner:a0", "refiner:a3"))
        rows = EvaluationOptions(choices, ("stereo",)).rows
        assert rows == ("refiner:a0 stereo", "refiner:a3 stereo", "nstep wrapped stereo", "nstep stereo")


def test_without_traits_and_edges_there_are_no_classes() -> None:
    bare = SampleResult("a", None, "reference", {}, {}, {})
    assert by_class([bare]) == {}
    evaluation = Evaluation((bare,), Summary.of([{}]), {}, {"methods": [], "dataset": "d", "split": "all"})
    assert "class" not in report_text(evaluation)
    assert "## By class" not in report_markdown(evaluation, "duofringe evaluate d")
    assert "differences" not in evaluation.as_json()
