"""Samples and datasets from the simulated rig."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from drivers.simulator.dataset import render_sample, simulate_dataset
from drivers.simulator.mesh_file import MeshFileError
from drivers.simulator.optics import Optics
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from models.capture import Capture, read_capture
from models.dataset import open_dataset
from models.errors import DatasetError, DuofringeError
from models.patterns import make_plan

SHORT = make_plan("full").restricted_to(["white", "composite", "black"])


@pytest.fixture(scope="module")
def quick() -> SimulatedRig:
    """One ray a pixel, one thread."""
    return SimulatedRig(optics=Optics(footprint=1), threads=1)


@pytest.fixture(scope="module")
def dataset_folder(tmp_path_factory, quick) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "set"
    simulate_dataset(folder, 4, 3, SHORT, rig=quick)
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def assert_same(one: Capture, other: Capture) -> None:
    assert one.record == other.record
    for side in ("left", "right"):
        for name in one.plan.names:
            assert np.array_equal(one.images[side][name], other.images[side][name]), (side, name)
    assert np.array_equal(one.truth.depth, other.truth.depth, equal_nan=True)
    assert np.array_equal(one.truth.projector_column, other.truth.projector_column, equal_nan=True)
    assert np.array_equal(one.truth.foreground, other.truth.foreground)


def test_same_seed_same_sample_however_it_is_computed(quick):
    threaded = SimulatedRig(optics=Optics(footprint=1), threads=3)
    first = render_sample(5, 2, SHORT, rig=quick)
    render_sample(5, 1, SHORT, rig=quick)
    assert_same(first, render_sample(5, 2, SHORT, rig=quick))
    assert_same(first, render_sample(5, 2, SHORT, rig=threaded))


def test_noise_of_a_pattern_does_not_depend_on_the_others(quick):
    alone = render_sample(5, 2, SHORT.restricted_to(["composite"]), rig=quick)
    together = render_sample(5, 2, SHORT, rig=quick)
    assert np.array_equal(alone.images["left"]["composite"], together.images["left"]["composite"])


def test_noise_differs_between_patterns_views_and_samples(quick):
    empty = Scene(())
    plan = make_plan("reference").restricted_to(["high_00", "high_01"])
    one, other = quick.render(empty, plan, (0, 0)), quick.render(empty, plan, (0, 1))
    # without a scene the light of all images is the same, so only noise can tell them apart
    images = [c.images[s][n] for c in (one, other) for s in ("left", "right") for n in plan.names]
    for i, image in enumerate(images):
        assert all((image != later).any() for later in images[i + 1 :])


def test_dataset_is_what_the_format_says(dataset_folder, quick):
    record = json.loads((dataset_folder / "dataset.json").read_text())
    assert record["schema"] == "dataset/1"
    assert record["calibration"] == json.loads(json.dumps(quick.rig.to_dict()))
    assert [p["name"] for p in record["plan"]["patterns"]] == ["white", "composite", "black"]
    dataset = open_dataset(dataset_folder)
    assert len(dataset) == 4
    names = [n for split in ("train", "val", "test") for n in dataset.splits[split]]
    assert sorted(names) == [f"sample-{i:05d}" for i in range(4)]
    assert all(dataset.splits[split] for split in ("train", "val", "test"))


def test_samples_read_back_as_they_were_rendered(dataset_folder, quick):
    for path in open_dataset(dataset_folder).capture_paths("all"):
        capture = read_capture(path)
        index = capture.record.settings["index"]
        assert capture.record.id == path.name == f"sample-{index:05d}"
        rendered = render_sample(3, index, SHORT, rig=quick)
        for side in ("left", "right"):
            assert all(np.array_equal(capture.images[side][n], rendered.images[side][n]) for n in SHORT.names)
        assert np.array_equal(capture.truth.depth, rendered.truth.depth, equal_nan=True)
        assert set(capture.truth.extra) == {
            "lit",
            "covisible",
            "object_index",
            "projector_row",
            "right_projector_column",
        }
        assert capture.truth.extra["lit"].dtype == bool
        assert capture.record.object_id == rendered.record.object_id


def test_objects_are_disjoint_between_splits(dataset_folder):
    dataset = open_dataset(dataset_folder)
    objects = {s: {read_capture(p).record.object_id for p in dataset.capture_paths(s)} for s in dataset.splits}
    assert not objects["train"] & objects["test"]
    assert not objects["train"] & objects["val"]
    assert not objects["val"] & objects["test"]


def test_workers_change_nothing_but_the_time(dataset_folder, tmp_path, quick):
    seen = []
    simulate_dataset(tmp_path / "again", 4, 3, SHORT, rig=quick, workers=2, progress=lambda d, n: seen.append((d, n)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert content(tmp_path / "again") == content(dataset_folder)


def test_larger_dataset_starts_with_the_smaller(dataset_folder, tmp_path, quick):
    simulate_dataset(tmp_path / "two", 2, 3, SHORT, rig=quick)
    small, large = content(tmp_path / "two" / "samples"), content(dataset_folder / "samples")
    assert small == {name: data for name, data in large.items() if name in small}
    assert open_dataset(tmp_path / "two").splits == {"train": (), "val": (), "test": ("sample-00000", "sample-00001")}


def test_interrupted_dataset_leaves_nothing(tmp_path, quick):
    def interrupt(done: int, samples: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_dataset(tmp_path / "set", 3, 0, SHORT, rig=quick, progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_output_must_be_new_and_its_parent_old(tmp_path, quick):
    (tmp_path / "taken").mkdir()
    with pytest.raises(DuofringeError, match="exists already"):
        simulate_dataset(tmp_path / "taken", 1, 0, SHORT, rig=quick)
    with pytest.raises(DuofringeError, match="does not exist"):
        simulate_dataset(tmp_path / "no" / "set", 1, 0, SHORT, rig=quick)
    with pytest.raises(DatasetError, match="at least one"):
        simulate_dataset(tmp_path / "set", 0, 0, SHORT, rig=quick)
    with pytest.raises(DatasetError, match="seed"):
        simulate_dataset(tmp_path / "set", 1, -1, SHORT, rig=quick)


def test_objects_may_come_from_mesh_files(tmp_path, quick):
    trimesh.creation.torus(4.0, 1.5).export(tmp_path / "ring.stl")
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "brick.stl")
    meshes = [tmp_path / "ring.stl", tmp_path / "brick.stl"]
    dataset = simulate_dataset(tmp_path / "set", 3, 0, SHORT, rig=quick, meshes=meshes)
    captures = [read_capture(p) for p in dataset.capture_paths("test")]
    assert [c.record.object_id for c in captures] == ["ring", "brick", "ring"]
    for capture in captures:
        assert (capture.truth.extra["object_index"] == 0).mean() > 0.05


def test_bad_mesh_is_told_before_anything_is_rendered(tmp_path, quick):
    with pytest.raises(MeshFileError, match=r"absent\.stl"):
        simulate_dataset(tmp_path / "set", 3, 0, SHORT, rig=quick, meshes=[tmp_path / "absent.stl"])
    assert list(tmp_path.iterdir()) == []


def test_a_plain_rig_will_do(quick):
    capture = render_sample(0, 0, SHORT.restricted_to(["white"]), rig=quick.rig)
    assert capture.rig is quick.rig
