"""Rig calibrations: the project's JSON, OpenCV's files, and every way in which they can be wrong."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulator.geometry import reference_rig
from models.errors import CalibrationError, DuofringeError
from models.geometry.device import Device
from models.geometry.opencv_files import read_opencv_cameras
from models.geometry.rectification import rectify
from models.geometry.rig import Rig
from models.patterns import Raster

DEVICES = ("left", "right", "projector")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=12,
)


def assert_same_device(a: Device, b: Device) -> None:
    assert (a.size, a.name) == (b.size, b.name)
    for key in ("matrix", "distortion", "rotation", "translation"):
        np.testing.assert_array_equal(getattr(a, key), getattr(b, key))


def assert_same_rig(a: Rig, b: Rig) -> None:
    assert_same_device(a.left, b.left)
    assert_same_device(a.right, b.right)
    assert a.raster == b.raster
    assert a.quality == b.quality
    if a.projector and b.projector:
        assert_same_device(a.projector, b.projector)


def test_json_round_trip_is_exact(rig, tmp_path):
    rig.to_file(tmp_path / "calibration.json")
    assert_same_rig(Rig.from_file(tmp_path / "calibration.json"), rig)
    assert [p.name for p in tmp_path.iterdir()] == ["calibration.json"]


def test_round_trip_without_projector(rig, tmp_path):
    pair = Rig(rig.left, rig.right)
    pair.to_file(tmp_path / "calibration.json")
    back = Rig.from_file(tmp_path / "calibration.json")
    assert back.projector is None
    assert back.raster is None
    assert "projector" not in json.loads((tmp_path / "calibration.json").read_text())


def test_the_file_has_the_documented_form(rig):
    data = rig.to_dict()
    assert (data["schema"], data["units"]) == ("rig-calibration/1", "mm")
    assert set(data["left"]) == {"size", "matrix", "distortion"}
    assert set(data["right"]) == {"size", "matrix", "distortion", "rotation", "translation"}
    assert set(data["projector"]) == set(data["right"]) | {"raster"}
    assert data["projector"]["raster"] == "diamond"
    assert data["left"]["size"] == [640, 480]


def test_the_raster_is_square_unless_the_file_says_diamond(rig):
    data = rig.to_dict()
    del data["projector"]["raster"]
    assert Rig.from_dict(data).raster == Raster(912, 1140, "square")


def test_writing_into_a_missing_folder_names_it(rig, tmp_path):
    with pytest.raises(DuofringeError, match="nowhere"):
        rig.to_file(tmp_path / "nowhere" / "calibration.json")
    assert list(tmp_path.iterdir()) == []


def test_working_depths_hold_what_every_device_sees(rig):
    near, far = rig.working_depths
    assert 250 < near < 450
    assert 600 < far < 1100
    grid = rig.left.pixel_grid()[::20, ::20].reshape(-1, 2)
    for depth in (near, 500, far):
        points = rig.left.back_project(grid, np.full(len(grid), depth))
        for device in (rig.right, rig.projector):
            assert device.contains(device.project(points)).mean() > 0.88


def test_a_stated_working_range_goes_first(rig):
    assert Rig(rig.left, rig.right, quality={"working_range_mm": [400, 670]}).working_depths == (400, 670)


@pytest.mark.parametrize("stated", [["a", "b"], [5, 1], [float("nan"), 3], [1], "400-670", None])
def test_a_senseless_working_range_is_estimated_instead(rig, stated):
    expected = Rig(rig.left, rig.right).working_depths
    assert Rig(rig.left, rig.right, quality={"working_range_mm": stated}).working_depths == expected


def test_cameras_that_look_apart_have_no_common_volume(rig):
    away = Device((640, 480), rig.right.matrix, rig.right.distortion, np.diag([-1, 1, -1]), [0, 0, -100])
    with pytest.raises(CalibrationError, match="no common volume"):
        _ = Rig(rig.left, away).working_depths


def _without(*path: str):
    def change(data: dict[str, Any]) -> None:
        for key in path[:-1]:
            data = data[key]
        del data[path[-1]]

    return change


def _with(value: Any, *path: str):
    def change(data: dict[str, Any]) -> None:
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = value

    return change


BAD_ROTATION = [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_without("schema"), "schema"),
        (_with("rig-calibration/2", "schema"), "schema is 'rig-calibration/2'"),
        (_with("m", "units"), "units"),
        (_without("left"), "lacks 'left'"),
        (_without("right"), "lacks 'right'"),
        (_with([], "left"), "lacks 'left'"),
        (_without("left", "matrix"), "left: lacks matrix"),
        (_without("right", "rotation"), "right: lacks rotation"),
        (_without("projector", "translation"), "projector: lacks translation"),
        (_with(float("nan"), "left", "matrix"), "left: matrix"),
        (_with([[0.0] * 3] * 3, "left", "matrix"), "left: matrix is singular"),
        (_with([[float("nan")] * 3] * 3, "right", "matrix"), "right: matrix contains NaN"),
        (_with("zero", "right", "distortion"), "right: distortion"),
        (_with([0.0] * 6, "left", "distortion"), "left: distortion has 6 terms"),
        (_with(BAD_ROTATION, "right", "rotation"), "right: rotation"),
        (_with([0, 0, 0], "right", "translation"), "right: translation is zero"),
        (_with([640], "left", "size"), "left: size"),
        (_with([640.5, 480], "left", "size"), "left: size"),
        (_with([float("inf"), 480], "left", "size"), "left: size"),
        (_with(["640", 480], "left", "size"), "left: size"),
        (_with([0, 480], "left", "size"), "left: size"),
        (_with("hexagonal", "projector", "raster"), "projector: raster"),
        (_with(3, "projector"), "'projector'"),
        (_with([1, 2], "quality"), "quality"),
    ],
)
def test_malformed_calibrations_name_the_file_and_the_field(rig, tmp_path, change, named):
    data = copy.deepcopy(rig.to_dict())
    change(data)
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(data))
    with pytest.raises(CalibrationError, match=named) as caught:
        Rig.from_file(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"3", b"\xff\xfe\x00", b"[" * 100_000, b'{"schema": 1'])
def test_files_that_are_no_calibration_say_so(tmp_path, content):
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=r"calibration\.json"):
        Rig.from_file(path)


def test_a_missing_file_says_so(tmp_path):
    with pytest.raises(CalibrationError, match="does not exist"):
        Rig.from_file(tmp_path / "none.json")


def test_a_projector_comes_with_a_raster_of_its_size(rig):
    with pytest.raises(CalibrationError, match="come together"):
        Rig(rig.left, rig.right, rig.projector)
    with pytest.raises(CalibrationError, match="raster has 900 columns"):
        Rig(rig.left, rig.right, rig.projector, Raster(900, 1140))


@given(JSON)
def test_any_json_is_a_calibration_or_an_error_in_words(data):
    with pytest.raises(CalibrationError):
        Rig.from_dict(data)


@given(data=st.data())
def test_any_damage_to_one_field_is_an_error_in_words_or_harmless(rig, data):
    damaged = copy.deepcopy(rig.to_dict())
    fields = [(k,) for k in damaged] + [(k, field) for k in DEVICES for field in damaged[k]]
    path = data.draw(st.sampled_from(fields))
    (_with(data.draw(JSON), *path) if data.draw(st.booleans()) else _without(*path))(damaged)
    message = ""
    try:
        Rig.from_dict(damaged)
    except CalibrationError as error:
        message = str(error)
    assert "\n" not in message


def write_storage(path: Path, **fields: Any) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in fields.items():
        storage.write(name, value)
    storage.release()
    return path


def stereo_fields(rig: Rig) -> dict[str, Any]:
    left, right = rig.left, rig.right
    return {
        "M1": left.matrix,
        "D1": left.distortion[None],
        "M2": right.matrix,
        "D2": right.distortion[None],
        "R": right.rotation,
        "T": right.translation[:, None],
        "imageSize": np.array([640, 480]),
    }


@pytest.mark.parametrize("suffix", ["yml", "yaml", "xml"])
def test_opencv_stereo_files_give_the_same_cameras(rig, tmp_path, suffix):
    back = Rig.from_file(write_storage(tmp_path / f"stereo.{suffix}", **stereo_fields(rig)))
    assert_same_device(back.left, rig.left)
    assert_same_device(back.right, rig.right)
    assert back.projector is None


def test_opencv_names_rotation_vector_units_and_two_files(rig, tmp_path):
    fields = stereo_fields(rig)
    renamed = {"K1": fields["M1"], "D1": fields["D1"], "K2": fields["M2"], "kc_right": fields["D2"]}
    inner = write_storage(tmp_path / "intrinsics.yml", **renamed)
    vector = cv2.Rodrigues(rig.right.rotation)[0]
    outer = write_storage(tmp_path / "extrinsics.yml", R=vector, T=fields["T"] / 1000)
    left, right = read_opencv_cameras(
        [inner, outer], names={"right_distortion": "kc_right"}, size=(640, 480), millimetres_per_unit=1000
    )
    assert_same_device(left, rig.left)
    np.testing.assert_allclose(right.rotation, rig.right.rotation, atol=1e-12)
    np.testing.assert_allclose(right.translation, rig.right.translation, atol=1e-9)


def test_an_opencv_file_without_size_needs_it_from_the_caller(rig, tmp_path):
    fields = stereo_fields(rig)
    del fields["imageSize"]
    path = write_storage(tmp_path / "stereo.yml", **fields)
    with pytest.raises(CalibrationError, match=r"stereo\.yml: lacks the image size"):
        Rig.from_file(path)
    assert Rig.from_file(path, size=(640, 480)).left.size == (640, 480)


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("M1", None, "left_matrix"),
        ("T", None, "translation"),
        ("M1", np.full((3, 3), np.nan), "left: matrix contains NaN"),
        ("M2", np.eye(2), "right: matrix has shape"),
        ("R", np.ones((3, 3)), "right: rotation"),
        ("T", np.zeros((3, 1)), "right: translation is zero"),
        ("M1", "a text", "left_matrix"),
        ("imageSize", np.array([640.5, 480]), "image size"),
        ("imageSize", np.array([640, 480, 1]), "image size"),
    ],
)
def test_malformed_opencv_files_name_file_and_field(rig, tmp_path, field, value, named):
    fields = {**stereo_fields(rig), field: value}
    path = write_storage(tmp_path / "stereo.yml", **{k: v for k, v in fields.items() if v is not None})
    with pytest.raises(CalibrationError, match=named) as caught:
        Rig.from_file(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).count("stereo.yml") == 1


@pytest.mark.parametrize(
    "content",
    [
        "",
        "garbage",
        "%YAML:1.0\n---\nM1: [1, 2\n",
        "%YAML:1.0\n---\nM1: {a: 1}\n",
        "%YAML:1.0\n---\nM1: [1, 2, three]\n",
        "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [1, 2]\n",
        "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: z\n   data: [1, 2]\n",
    ],
)
def test_damaged_opencv_files_are_an_error_in_words(tmp_path, content):
    path = tmp_path / "stereo.yml"
    path.write_text(content)
    with pytest.raises(CalibrationError, match=r"stereo\.yml") as caught:
        Rig.from_file(path)
    assert "\n" not in str(caught.value)


@pytest.mark.realdata
def test_a_recorded_opencv_calibration_is_read(real_data):
    folder = real_data / "stereo_small_mit"
    left, right = read_opencv_cameras([folder / "intrinsics.yml", folder / "extrinsics.yml"], size=(1280, 1024))
    assert left.size == right.size == (1280, 1024)
    assert left.distortion.size == 14
    np.testing.assert_allclose(right.translation, [-120.83, 0.405, 5.836], atol=1e-3)
    grid = left.pixel_grid()[::64, ::64]
    for device in (left, right):
        back = device.project(device.back_project(grid, np.full(grid.shape[:2], 900.0)))
        np.testing.assert_allclose(back, grid, atol=1e-5)


def test_rigs_of_one_calibration_are_equal_so_that_what_is_built_for_them_is_built_once() -> None:
    rig = reference_rig()
    again = Rig.from_dict(rig.to_dict())
    other = reference_rig("square")
    assert again == rig
    assert hash(again) == hash(rig)
    assert other != rig
    assert rectify(again) is rectify(rig)
