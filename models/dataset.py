"""Datasets: folders of captures with splits that share no object."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from models.capture import RECORD_NAME as CAPTURE_RECORD_NAME
from models.errors import DatasetError, DuofringeError
from models.geometry.rig import Rig
from models.patterns import PatternPlan

RECORD_NAME = "dataset.json"
SAMPLES_NAME = "samples"
ALL = "all"
SPLITS: tuple[str, str, str] = ("train", "val", "test")
_VAL_SHARE = _TEST_SHARE = 0.15


class DatasetRecord(BaseModel):
    """``dataset.json``. Unknown keys are kept."""

    model_config = ConfigDict(extra="allow", populate_by_name=True)

    schema_: Literal["dataset/1"] = Field(default="dataset/1", alias="schema")
    calibration: dict[str, Any] | None = None
    plan: PatternPlan | None = None
    splits: dict[str, tuple[str, ...]]

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


@dataclass(frozen=True, eq=False)
class Dataset:
    """Captures by split; nothing but paths is held in memory.

    root: the dataset's folder. samples: path of every capture by its id. splits: ids by split, or None for a plain
    folder of captures, which has no splits. rig, plan: common to all captures where the dataset states them.
    """

    root: Path
    samples: Mapping[str, Path]
    splits: Mapping[str, tuple[str, ...]] | None = None
    rig: Rig | None = None
    plan: PatternPlan | None = None

    def __len__(self) -> int:
        return len(self.samples)

    def capture_paths(self, split: str = ALL) -> tuple[Path, ...]:
        """Capture folders of a split, in the order of the dataset; "all" gives every capture.

        A plain folder of captures gives all of them whatever split is asked. Raises DatasetError for a split that the
        dataset lacks or that is empty.
        """
        if self.splits is None or split == ALL:
            return tuple(self.samples.values())
        if split not in self.splits:
            raise DatasetError(
                f"dataset '{self.root}' has no split '{split}'; it has {', '.join(self.splits)} and '{ALL}'"
            )
        if not self.splits[split]:
            raise DatasetError(
                f"split '{split}' of dataset '{self.root}' is empty; take another split or a larger dataset"
            )
        return tuple(self.samples[name] for name in self.splits[split])


def open_dataset(path: Path | str) -> Dataset:
    """A dataset folder, any folder of capture folders, or one capture folder.

    Captures themselves are read and checked when they are used. Raises DatasetError naming what is wrong.
    """
    root = Path(path)
    if not root.is_dir():
        raise DatasetError(f"dataset '{root}' is not a folder")
    record_path = root / RECORD_NAME
    if record_path.is_file():
        return _open_recorded(root, _read_record(record_path))
    if _is_capture(root):
        return Dataset(root, {root.name: root})
    parent = root / SAMPLES_NAME if (root / SAMPLES_NAME).is_dir() else root
    captures = {p.name: p for p in sorted(parent.iterdir()) if not p.name.startswith(".") and _is_capture(p)}
    if not captures:
        raise DatasetError(f"'{root}' holds neither {RECORD_NAME} nor any capture folder")
    return Dataset(root, captures)


def _is_capture(folder: Path) -> bool:
    return (folder / CAPTURE_RECORD_NAME).is_file() or (folder / "left").is_dir()


def _read_record(path: Path) -> DatasetRecord:
    try:
        return DatasetRecord.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "content"
        raise DatasetError(f"{path}: {where}: {first['msg']}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: not readable as JSON ({error})") from error


def _open_recorded(root: Path, record: DatasetRecord) -> Dataset:
    samples: dict[str, Path] = {}
    for split, names in record.splits.items():
        for name in names:
            folder = root / SAMPLES_NAME / name
            if name in ("", ".", "..") or Path(name).name != name:
                raise DatasetError(f"{root / RECORD_NAME}: splits.{split}: '{name}' is not a sample id")
            if name in samples:
                raise DatasetError(f"{root / RECORD_NAME}: sample '{name}' stands twice in the splits")
            if not _is_capture(folder):
                raise DatasetError(f"dataset '{root}' is damaged: split '{split}' names '{name}', which is missing")
            samples[name] = folder
    if not samples:
        raise DatasetError(f"dataset '{root}' has no samples")
    try:
        rig = None if record.calibration is None else Rig.from_dict(record.calibration)
    except DuofringeError as error:
        raise DatasetError(f"{root / RECORD_NAME}: {error}") from error
    return Dataset(root, dict(sorted(samples.items())), record.splits, rig, record.plan)


def split_by_object(object_of: Mapping[str, str], seed: int) -> dict[str, tuple[str, ...]]:
    """Divide samples 70 / 15 / 15 into train, val and test so that no object stands in two splits.

    object_of: object id by sample id. Each split has at least one object when there are three; with fewer, everything
    is for testing. The draw depends on the seed and the ids only.
    """
    objects = sorted(set(object_of.values()))
    share = dict.fromkeys(objects, "test")
    if len(objects) >= len(SPLITS):
        order = [objects[i] for i in np.random.default_rng([seed, len(objects)]).permutation(len(objects))]
        tests, vals = (max(1, round(part * len(objects))) for part in (_TEST_SHARE, _VAL_SHARE))
        share |= dict.fromkeys(order[tests : tests + vals], "val") | dict.fromkeys(order[tests + vals :], "train")
    return {split: tuple(s for s in sorted(object_of) if share[object_of[s]] == split) for split in SPLITS}
