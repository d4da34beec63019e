"""Folders to replay from, whole and damaged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from recorded import PLAN, write

from drivers.camera import AppliedSettings
from drivers.errors import DeviceNotFoundError
from drivers.replay.source import ReplaySource
from models.dataset import DatasetRecord
from models.errors import CaptureError
from models.geometry.rig import Rig
from models.png import read_png, write_png

_ANY = AppliedSettings(8333.0, 0.0, 8, 255, (32, 24))


def flip_a_pixel_byte(png: Path) -> None:
    """Damage that only decoding finds."""
    data = bytearray(png.read_bytes())
    data[len(data) // 2] ^= 0xFF
    png.write_bytes(bytes(data))


def truncate(png: Path) -> None:
    png.write_bytes(png.read_bytes()[:-20])


def test_one_capture_folder_is_a_round_of_one(tmp_path: Path) -> None:
    source = ReplaySource(write(tmp_path, "single"))
    assert source.scenes == ("single",)
    assert [source.place(), source.place()] == ["single", "single"]
    assert source.warnings == ()


def test_a_dataset_gives_its_samples_in_name_order_and_its_calibration(tmp_path: Path, rig: Rig) -> None:
    (tmp_path / "samples").mkdir()
    for name in ("s2", "s0", "s1"):
        write(tmp_path / "samples", name)
    record = DatasetRecord(splits={"test": ("s2",), "train": ("s1", "s0")}, calibration=rig.to_dict())
    (tmp_path / "dataset.json").write_text(record.to_json(), encoding="utf-8")
    source = ReplaySource(tmp_path)
    assert source.scenes == ("s0", "s1", "s2")
    assert source.calibration == rig
    assert ReplaySource(tmp_path / "samples").scenes == ("s0", "s1", "s2")


@pytest.mark.parametrize("at", ["first", "last"])
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        ("truncated", "truncated"),
        ("missing", "lacks"),
        ("record", "not readable as JSON"),
        ("one view", "one view"),
        ("right lost", "lacks"),
        ("empty file", "truncated"),
        ("calibration", "calibration"),
    ],
)
def test_an_unusable_capture_is_left_out_with_a_warning(tmp_path: Path, damage: str, reason: str, at: str) -> None:
    write(tmp_path, "m")
    name = "a" if at == "first" else "z"
    folder = write(tmp_path, name, sides=("left",) if damage == "one view" else ("left", "right"))
    png = folder / "left" / "composite.png"
    if damage == "truncated":
        truncate(png)
    elif damage == "missing":
        png.unlink()
    elif damage == "empty file":
        png.write_bytes(b"")
    elif damage == "right lost":
        for file in (folder / "right").iterdir():
            file.unlink()
        (folder / "right").rmdir()
    elif damage == "record":
        (folder / "capture.json").write_text("{", encoding="utf-8")
    elif damage == "calibration":
        record = json.loads((folder / "capture.json").read_text(encoding="utf-8"))
        record["calibration"] = {"schema": "rig-calibration/1"}
        (folder / "capture.json").write_text(json.dumps(record), encoding="utf-8")
    source = ReplaySource(tmp_path)
    assert source.scenes == ("m",)
    (warning,) = source.warnings
    assert f"'{name}'" in warning
    assert reason in warning
    assert len(warning.splitlines()) == 1
    with pytest.raises(DeviceNotFoundError):
        source.place(name)


def test_damage_inside_an_image_at_the_front_is_found_at_once(tmp_path: Path) -> None:
    flip_a_pixel_byte(write(tmp_path, "a") / "right" / "white.png")
    write(tmp_path, "b")
    source = ReplaySource(tmp_path)
    assert source.scenes == ("b",)
    assert "a" in source.warnings[0]
    assert source.place() == "b"


def test_damage_inside_a_later_image_is_told_when_it_is_placed_and_the_round_goes_on(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        write(tmp_path, name)
    flip_a_pixel_byte(tmp_path / "b" / "left" / "white.png")
    source = ReplaySource(tmp_path)
    assert source.place() == "a"
    with pytest.raises(CaptureError, match="white"):
        source.place()
    assert source.scene == "a"
    assert [source.place(), source.place()] == ["c", "a"]


def test_images_of_different_sizes_are_found_at_once_at_the_front(tmp_path: Path) -> None:
    folder = write(tmp_path, "a")
    write_png(folder / "left" / "white.png", np.zeros((5, 5), np.uint8))
    write(tmp_path, "b")
    assert ReplaySource(tmp_path).scenes == ("b",)
    assert read_png(tmp_path / "b" / "left" / "white.png").shape != (5, 5)


def test_where_nothing_is_usable_the_reason_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFoundError, match="not a folder"):
        ReplaySource(tmp_path / "absent")
    with pytest.raises(DeviceNotFoundError, match="neither"):
        ReplaySource(tmp_path)
    write(tmp_path, "half", sides=("left",))
    with pytest.raises(DeviceNotFoundError, match="one view"):
        ReplaySource(tmp_path)
    truncate(write(tmp_path, "damaged") / "left" / "white.png")
    with pytest.raises(DeviceNotFoundError) as caught:
        ReplaySource(tmp_path)
    assert len(str(caught.value).splitlines()) == 1


def test_only_the_present_capture_is_in_memory(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write(tmp_path, name)
    source = ReplaySource(tmp_path)
    before = source.view("left", PLAN.patterns[0], _ANY, brightness=1.0, shot=0)
    (tmp_path / "a" / "left" / "white.png").unlink()
    assert source.place() == "a"
    assert source.view("left", PLAN.patterns[0], _ANY, brightness=1.0, shot=0) is before
    source.place("b")
    with pytest.raises(CaptureError):
        source.place("a")
