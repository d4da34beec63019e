"""Commands on real files: a small simulated rig, from dataset to tables, and the two recorded sets."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.simulator.dataset import simulate_dataset
from drivers.simulator.geometry import reference_rig
from drivers.simulator.rig import SimulatedRig
from models.capture import read_capture
from models.errors import ReconstructionError
from models.geometry.device import Device
from models.geometry.rig import Rig
from models.patterns import make_plan
from models.refiner.shipped import find_weights
from service import process_pool

Run = Callable[..., tuple[int, str, str]]
EXAMPLES = Path(__file__).parent.parent / "examples" / "manifests"
SIZE = (208, 160)


def middle_of(device: Device) -> Device:
    """The same camera, reading out only the middle of its sensor."""
    matrix = device.matrix.copy()
    matrix[:2, 2] -= (np.array(device.size) - SIZE) / 2
    return replace(device, size=SIZE, matrix=matrix)


@pytest.fixture(scope="session")
def small_rig() -> Rig:
    rig = reference_rig()
    quality = {**rig.quality, "working_range_mm": [400.0, 670.0]}
    return replace(rig, left=middle_of(rig.left), right=middle_of(rig.right), quality=quality)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory, small_rig: Rig) -> Path:
    """Two samples under the full plan, both in the split "test"."""
    folder = tmp_path_factory.mktemp("simulated") / "set"
    simulate_dataset(folder, 2, 5, make_plan("full"), rig=SimulatedRig(rig=small_rig))
    return folder


@pytest.fixture
def capture(dataset: Path) -> Path:
    return dataset / "samples" / "sample-00000"


class TestReconstruct:
    def test_cloud_lies_on_the_truth(self, run: Run, capture: Path, tmp_path: Path) -> None:
        output = tmp_path / "cloud.npz"
        status, out, err = run("reconstruct", capture, "--method", "nstep", "--output", output, "--json")
        assert status == 0
        summary = json.loads(out)
        assert summary["matching"] == "trinocular"
        assert "reconstruct: phase" in err
        truth = read_capture(capture).truth
        assert truth is not None
        with np.load(output, allow_pickle=False) as arrays:
            valid = arrays["mask"] == 0
            error = np.abs(arrays["points"][..., 2] - truth.depth)[valid & truth.foreground]
            assert valid.sum() == summary["points"]
        assert np.median(error) < 0.2
        assert len(error) > 0.8 * truth.foreground.sum()

    def test_matching_and_depth_range_are_obeyed(self, run: Run, capture: Path, tmp_path: Path) -> None:
        near, far = 400.0, 520.0
        output = tmp_path / "cloud.npz"
        arguments = ("--method", "nstep", "--matching", "stereo", "--depth-range", near, far, "--output", output)
        status, out, _ = run("reconstruct", capture, *map(str, arguments), "--json")
        assert status == 0
        assert json.loads(out)["matching"] == "stereo"
        with np.load(output, allow_pickle=False) as arrays:
            depth = arrays["points"][..., 2]
            assert np.nanmin(depth) >= near
            assert np.nanmax(depth) <= far
            assert set(np.unique(arrays["origin"])) == {0, 1}

    def test_another_calibration_goes_before_the_copy(
        self, run: Run, capture: Path, tmp_path: Path, small_rig: Rig
    ) -> None:
        """A baseline twice as long puts the same disparities twice as far away."""
        right = replace(small_rig.right, translation=2 * small_rig.right.translation)
        replace(small_rig, right=right, projector=None, raster=None).to_file(tmp_path / "wide.json")
        told = []
        for extra in ((), ("--calibration", tmp_path / "wide.json", "--depth-range", "800", "1340")):
            status, out, _ = run(
                "reconstruct", capture, "--method", "nstep", *extra, "--output", tmp_path / "c.ply", "--json"
            )
            assert status == 0
            told.append(json.loads(out))
        assert told[1]["z_mm"][1] == pytest.approx(2 * told[0]["z_mm"][1], rel=0.02)
        assert told[1]["matching"] == "stereo"

    def test_the_refiner_names_its_weights(self, run: Run, capture: Path, tmp_path: Path) -> None:
        shipped = find_weights()
        arguments = ("reconstruct", capture, "--method", "refiner", "--output", tmp_path / "c.ply")
        told = []
        for named, name in (((), "sim"), (("--weights", "sim"), "sim"), (("--weights", shipped), str(shipped))):
            status, out, _ = run(*arguments, *named, "--json")
            assert status == 0
            told.append(json.loads(out))
            assert told[-1]["weights"]["name"] == name
            assert told[-1]["weights"]["variant"] == "sim"
        record = json.loads((shipped / "refiner.json").read_text())
        assert {one["weights"]["sha256"] for one in told} == {record["sha256"]}
        assert len({one["points"] for one in told}) == 1
        status, out, _ = run(*arguments)
        assert f"weights sim (sim, sha256 {record['sha256'][:12]})" in out
        status, out, _ = run(*arguments[:3], "wft", *arguments[4:], "--json")
        assert json.loads(out)["weights"] is None

    def test_weights_that_do_not_serve_are_told_in_one_line(self, run: Run, capture: Path, tmp_path: Path) -> None:
        other = tmp_path / "other"
        shutil.copytree(find_weights(), other, copy_function=shutil.copyfile)
        record = json.loads((other / "refiner.json").read_text())
        (other / "refiner.json").write_text(json.dumps({**record, "periods": [8.0, 13.0]}))
        arguments = ("reconstruct", capture, "--method", "refiner", "--output", tmp_path / "c.ply", "--weights")
        for weights, reason in (
            ("nobody", "'nobody' are neither a folder nor shipped; shipped are sim"),
            (other, f"{other}: weights are for fringes of 8 and 13 columns, not 9 and 14"),
        ):
            status, out, err = run(*arguments, weights)
            assert (status, out) == (1, "")
            assert reason in err.splitlines()[-1]
            assert not (tmp_path / "c.ply").exists()

    def test_a_damaged_capture_leaves_no_output(self, run: Run, capture: Path, tmp_path: Path) -> None:
        copy = tmp_path / "copy"
        for path in capture.rglob("*"):
            if path.is_file() and path.name != "high_03.png":
                (copy / path.relative_to(capture)).parent.mkdir(parents=True, exist_ok=True)
                (copy / path.relative_to(capture)).write_bytes(path.read_bytes())
        status, _, err = run("reconstruct", copy, "--method", "nstep", "--output", tmp_path / "c.ply")
        assert status == 1
        assert "left/high_03.png" in err.splitlines()[-1]
        assert not (tmp_path / "c.ply").exists()


class TestSimulate:
    def test_dataset_has_truth_splits_and_the_bits_asked_for(self, run: Run, tmp_path: Path) -> None:
        output = tmp_path / "set"
        arguments = ("--samples", "1", "--seed", "3", "--plan", "composite", "--bits", "12", "--raster", "square")
        status, out, err = run("simulate", *arguments, "--output", output, "--json")
        assert status == 0
        assert json.loads(out)["splits"] == {"train": 0, "val": 0, "test": 1}
        assert "1 of 1 samples" in err
        capture = read_capture(output / "samples" / "sample-00000")
        assert capture.white_level == 4095
        assert capture.rig is not None
        assert capture.rig.raster is not None
        assert capture.rig.raster.kind == "square"
        assert capture.truth is not None


class TestEvaluate:
    def test_tables_and_json_of_both_methods(self, run: Run, dataset: Path, tmp_path: Path) -> None:
        output = tmp_path / "figures.json"
        status, out, _ = run("evaluate", dataset, "--methods", "nstep,wft", "--output", output)
        assert status == 0
        assert out.count("Valid %") == 2  # of the whole split, and by class
        assert "common MAE_z" in out
        figures = json.loads(output.read_text())
        assert list(figures["rows"]) == ["nstep", "wft", "nstep wrapped"]
        stepped, single = figures["rows"]["nstep"], figures["rows"]["wft"]
        assert stepped["order_accuracy"] > 85
        assert stepped["median_depth"] < 0.2 < single["p95_depth"]
        assert stepped["common_pixels"] == single["common_pixels"] > 0
        assert set(stepped["timings_s"]) == {"phase", "matching", "points"}
        low, high = stepped["intervals"]["valid"]
        assert low <= stepped["valid"] <= high
        assert [s["sample"] for s in figures["samples"]] == ["sample-00000", "sample-00001"]
        pixels = [s["rows"]["nstep"]["pixels"] for s in figures["samples"]]
        assert sum(pixels) == stepped["pixels"]

    def test_workers_give_the_same_figures(self, run: Run, dataset: Path) -> None:
        told = []
        for workers in ("1", "2"):
            status, out, _ = run("evaluate", dataset, "--methods", "nstep", "--workers", workers, "--json")
            assert status == 0
            told.append(json.loads(out)["rows"]["nstep"])
        for row in told:
            row.pop("timings_s")
        assert told[0] == told[1]

    def test_the_capture_s_own_steps_serve_as_truth(self, run: Run, capture: Path) -> None:
        """The paper's protocol: against itself N-step is without error, and it agrees with the simulator's truth."""
        rows = {}
        for truth in ("reference", "simulator"):
            arguments = ("--methods", "nstep,wft", "--matching", "stereo", "--truth", truth, "--json")
            status, out, _ = run("evaluate", capture, *arguments)
            assert status == 0
            rows[truth] = json.loads(out)["rows"]
        assert rows["reference"]["nstep stereo"]["mae_depth"] == pytest.approx(0, abs=1e-6)
        accuracies = [rows[truth]["wft stereo"]["within_1mm"] for truth in rows]
        assert abs(accuracies[0] - accuracies[1]) < 6

    def test_a_failed_reconstruction_counts_as_no_pixel(
        self, run: Run, dataset: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from service import sample_evaluation

        whole = sample_evaluation.reconstruct

        def fails_for_wft(capture: Any, options: Any, **rest: Any) -> Any:
            if options.method == "wft":
                raise ReconstructionError("the views do not match")
            return whole(capture, options, **rest)

        monkeypatch.setattr(sample_evaluation, "reconstruct", fails_for_wft)
        status, out, err = run("evaluate", dataset, "--methods", "nstep,wft", "--json")
        assert status == 0
        assert "warning: sample-00001, wft: counted as no valid pixel: the views do not match" in err
        figures = json.loads(out)
        assert figures["rows"]["wft"]["valid"] == 0
        assert figures["rows"]["wft"]["mae_depth"] is None
        assert figures["rows"]["nstep"]["valid"] > 85
        assert figures["samples"][0]["failures"] == {"wft": "the views do not match"}

    def test_without_truth_or_steps_there_is_nothing_to_compare(self, run: Run, tmp_path: Path, dataset: Path) -> None:
        capture = read_capture(dataset / "samples" / "sample-00000", with_truth=False, kinds={"composite"})
        from models.capture import write_capture

        write_capture(capture, tmp_path / "bare")
        status, _, err = run("evaluate", tmp_path / "bare", "--methods", "wft")
        assert status == 1
        assert "bare: has neither truth/ nor N-step and Gray images" in err
        status, _, err = run("evaluate", tmp_path / "bare", "--methods", "wft", "--truth", "simulator")
        assert "bare: has no truth/" in err


def dies(number: int) -> int:
    import os
    import signal

    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_killed_worker_is_an_error_that_names_the_item() -> None:
    with pytest.raises(process_pool.WorkerKilledError, match=r"killed at .*item 2"):
        list(process_pool.map_in_processes(dies, [1, 2, 3], 2, name=lambda n: f"item {n}"))


def test_demo_writes_what_it_says(run: Run, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the small rig, without the recorded sets; an earlier demo is replaced, a stranger's folder is not."""
    monkeypatch.setattr("service.demonstration.render_sample", lambda *_: read_capture(capture))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DUOFRINGE_DATA", str(tmp_path / "none"))
    for _ in range(2):
        status, out, _ = run("demo", "--json")
        assert status == 0
    told = json.loads(out)
    assert told["results"]["nstep"]["errors"]["order_accuracy"] > 85
    written = {p.name for p in (tmp_path / "demo").iterdir()}
    assert list(told["results"]) == ["nstep", "wft_stereo", "wft", "refiner"]
    assert told["results"]["refiner"]["weights"]["name"] == "sim"
    assert told["results"]["wft"]["weights"] is None
    expected = {"capture", "nstep.ply", "wft.ply", "wft_stereo.ply", "wft.glb", "overview.png", "wft_depth.png"}
    expected |= {
        "refiner.ply",
        "refiner.glb",
        "refiner_depth.png",
        "refiner_surface.png",
        "refiner_phase_low_right.png",
    }
    assert expected <= written
    overview = cv2.imread(str(tmp_path / "demo" / "overview.png"))
    assert overview.shape[1] > 1200
    assert len(np.unique(overview.reshape(-1, 3), axis=0)) > 500
    foreign = tmp_path / "elsewhere"
    (foreign / "capture").mkdir(parents=True)
    status, _, err = run("demo", "--output", foreign)
    assert status == 1
    assert "is not the demonstration's" in err


@pytest.mark.realdata
def test_recorded_stereo_set_from_files_to_cloud(run: Run, real_data: Path, tmp_path: Path) -> None:
    arguments = (real_data / "stereo_small_mit", "--manifest", EXAMPLES / "stereo_small_mit.toml")
    status, out, _ = run("import", *arguments, "--output", tmp_path / "head", "--json")
    assert status == 0
    assert json.loads(out)["calibrated"] is True
    status, out, _ = run(
        "reconstruct", tmp_path / "head", "--method", "nstep", "--output", tmp_path / "head.ply", "--json"
    )
    assert status == 0
    cloud = json.loads(out)
    assert cloud["points"] > 100_000
    assert 830 < cloud["z_mm"][0] < cloud["z_mm"][1] < 990
