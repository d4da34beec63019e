"""Dataset folders: splits that share no object, and errors that name what is wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.capture import Capture, CaptureRecord, write_capture
from models.dataset import DatasetRecord, open_dataset, split_by_object
from models.errors import DatasetError
from models.patterns import make_plan

PLAN = make_plan("composite")


def write_sample(folder, seed=0) -> None:
    image = np.random.default_rng(seed).integers(0, 255, (6, 8), np.uint8)
    images = {"left": {"composite": image}, "right": {"composite": image}}
    write_capture(Capture(PLAN, images, record=CaptureRecord(id=folder.name, object_id=f"object-{seed}")), folder)


@pytest.fixture
def dataset(tmp_path, rig):
    """Three samples, one a split."""
    root = tmp_path / "set"
    (root / "samples").mkdir(parents=True)
    for i, name in enumerate("abc"):
        write_sample(root / "samples" / name, i)
    splits = {"train": ["b"], "val": ["c"], "test": ["a"]}
    record = DatasetRecord.model_validate({"calibration": rig.to_dict(), "plan": PLAN, "splits": splits})
    (root / "dataset.json").write_text(record.to_json())
    return root


def edit(root, **changes) -> None:
    data = json.loads((root / "dataset.json").read_text())
    (root / "dataset.json").write_text(json.dumps(data | changes))


def test_splits_name_their_captures(dataset, rig):
    opened = open_dataset(dataset)
    assert [p.name for p in opened.capture_paths("test")] == ["a"]
    assert [p.name for p in opened.capture_paths("all")] == ["a", "b", "c"]
    assert len(opened) == 3
    assert opened.plan == PLAN
    assert np.array_equal(opened.rig.left.matrix, rig.left.matrix)


def test_unknown_and_empty_splits_are_told(dataset):
    with pytest.raises(DatasetError, match="no split 'holdout'; it has train, val, test"):
        open_dataset(dataset).capture_paths("holdout")
    edit(dataset, splits={"train": ["a", "b", "c"], "test": []})
    with pytest.raises(DatasetError, match=r"'test'.* is empty"):
        open_dataset(dataset).capture_paths("test")


def test_any_folder_of_captures_is_a_dataset(tmp_path):
    for i, name in enumerate(("second", "first", ".hidden")):
        write_sample(tmp_path / name, i)
    (tmp_path / "notes").mkdir()
    (tmp_path / "readme.txt").write_text("not a capture")
    opened = open_dataset(tmp_path)
    for split in ("all", "test", "train"):
        assert [p.name for p in opened.capture_paths(split)] == ["first", "second"]
    assert opened.rig is None


def test_captures_without_record_count(tmp_path):
    (tmp_path / "old" / "left").mkdir(parents=True)
    assert [p.name for p in open_dataset(tmp_path).capture_paths("test")] == ["old"]


def test_one_capture_is_a_dataset_of_one(tmp_path):
    write_sample(tmp_path / "scene")
    assert open_dataset(tmp_path / "scene").capture_paths("test") == (tmp_path / "scene",)


def test_samples_without_dataset_record_are_found(dataset):
    (dataset / "dataset.json").unlink()
    assert [p.name for p in open_dataset(dataset).capture_paths("test")] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"schema": "dataset/9"}, "schema"),
        ({"splits": None}, "splits"),
        ({"splits": {"test": ["a", "zebra"]}}, "'zebra', which is missing"),
        ({"splits": {"test": ["a"], "train": ["a"]}}, "stands twice"),
        ({"splits": {"test": ["../samples/a"]}}, "not a sample id"),
        ({"splits": {"test": [".."]}}, "not a sample id"),
        ({"splits": {"test": []}}, "no samples"),
        ({"calibration": {"schema": "rig-calibration/1"}}, "lacks 'left'"),
        ({"plan": {"patterns": [{"name": "x", "kind": "high"}]}}, "plan"),
    ],
)
def test_damaged_records_are_named_in_one_line(dataset, changes, reason):
    edit(dataset, **changes)
    with pytest.raises(DatasetError, match=reason) as caught:
        open_dataset(dataset)
    assert str(dataset) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_dataset_is_told(tmp_path):
    with pytest.raises(DatasetError, match="not a folder"):
        open_dataset(tmp_path / "absent")
    with pytest.raises(DatasetError, match=r"neither dataset\.json nor any capture"):
        open_dataset(tmp_path)
    (tmp_path / "dataset.json").write_text("{ torn")
    with pytest.raises(DatasetError, match="not readable as JSON"):
        open_dataset(tmp_path)
    (tmp_path / "dataset.json").write_text("[" * 100_000)
    with pytest.raises(DatasetError, match="not readable as JSON"):
        open_dataset(tmp_path)


samples = st.dictionaries(
    st.text("abcdefgh0123", min_size=1, max_size=6), st.sampled_from([f"object-{i}" for i in range(20)]), min_size=1
)


@given(samples, st.integers(0, 2**32))
def test_splits_are_whole_disjoint_by_object_and_repeatable(object_of, seed):
    splits = split_by_object(object_of, seed)
    assert sorted(s for names in splits.values() for s in names) == sorted(object_of)
    objects = [{object_of[s] for s in splits[name]} for name in ("train", "val", "test")]
    assert sum(map(len, objects)) == len(set.union(*objects))
    assert splits["test"]
    if len(set(object_of.values())) >= 3:
        assert all(splits.values())
    else:
        assert not splits["train"]
    assert splits == split_by_object(dict(reversed(object_of.items())), seed)


def test_splits_are_seventy_fifteen_fifteen():
    splits = split_by_object({f"s{i:03d}": f"o{i:03d}" for i in range(100)}, 1)
    assert {name: len(names) for name, names in splits.items()} == {"train": 70, "val": 15, "test": 15}
    assert splits != split_by_object({f"s{i:03d}": f"o{i:03d}" for i in range(100)}, 2)
