"""Capture folders: what is written is what is read, and what is damaged is named."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from models.capture import Capture, CaptureRecord, DeviceRecord, Truth, read_capture, write_capture
from models.errors import CaptureError, DuofringeError
from models.patterns import FringeParameters, Raster, make_plan

SIZE = (12, 16)
SMALL = FringeParameters(periods=(9, 14), steps=(3, 4), raster=Raster(64, 8))


def make_capture(plan=None, *, dtype=np.uint8, sides=("left", "right"), seed=0, **fields) -> Capture:
    plan = plan or make_plan("full", SMALL)
    draw = np.random.default_rng(seed)
    top = np.iinfo(dtype).max
    images = {s: {p.name: draw.integers(0, top, SIZE, dtype, endpoint=True) for p in plan.patterns} for s in sides}
    fields.setdefault("record", CaptureRecord(id="scene", bit_depth=8 if dtype == np.uint8 else 16))
    return Capture(plan, images, **fields)


@pytest.fixture
def folder(tmp_path, rig) -> Path:
    """A whole default-parameter capture with calibration, on disk."""
    write_capture(make_capture(make_plan("full"), rig=rig), tmp_path / "scene")
    return tmp_path / "scene"


def assert_same_images(a: Capture, b: Capture) -> None:
    assert a.sides == b.sides
    for side in a.sides:
        assert list(a.images[side]) == list(b.images[side])
        for name, image in a.images[side].items():
            assert image.dtype == b.images[side][name].dtype
            np.testing.assert_array_equal(image, b.images[side][name])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("sides", [("left",), ("left", "right")])
def test_what_is_written_is_what_is_read(tmp_path, rig, dtype, sides):
    depth = np.full(SIZE, 500, np.float32)
    depth[0, 0] = np.nan
    truth = Truth(depth, depth / 2, depth > 0, {"lit": np.ones(SIZE, bool)})
    record = CaptureRecord.model_validate(
        {
            "id": "scene",
            "created": datetime(2025, 1, 2, tzinfo=UTC),
            "devices": [DeviceRecord(role=s, driver="replay", serial="7", origin="replayed") for s in sides],
            "settings": {"gain_db": 3.5},
            "frame_ids": {s: [1, 2] for s in sides},
            "warnings": ["left: 2 % saturated"],
            "object_id": "vase",
            "bit_depth": 8 if dtype == np.uint8 else 16,
            "something": {"else": [1]},
        }
    )
    written = make_capture(dtype=dtype, sides=sides, rig=rig, record=record, truth=truth)
    write_capture(written, tmp_path / "scene")
    back = read_capture(tmp_path / "scene")
    assert_same_images(back, written)
    assert back.plan == written.plan
    assert back.rig.to_dict() == rig.to_dict()
    kept = back.record.model_dump(exclude={"plan", "patterns", "calibration"})
    assert kept == record.model_dump(exclude={"plan", "patterns", "calibration"})
    np.testing.assert_array_equal(back.truth.depth, depth)
    np.testing.assert_array_equal(back.truth.projector_column, depth / 2)
    np.testing.assert_array_equal(back.truth.foreground, depth > 0)
    np.testing.assert_array_equal(back.truth.extra["lit"], True)
    write_capture(back, tmp_path / "again")
    assert (tmp_path / "again" / "capture.json").read_text() == (tmp_path / "scene" / "capture.json").read_text()


def test_a_failure_in_the_middle_leaves_nothing(tmp_path):
    capture = make_capture()
    del capture.images["right"]["black"]
    with pytest.raises(KeyError):
        write_capture(capture, tmp_path / "scene")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_capture_is_not_overwritten(folder):
    with pytest.raises(DuofringeError, match="exists already"):
        write_capture(make_capture(), folder)
    assert len(read_capture(folder).plan) == 33


def test_groups_can_be_read_alone(folder):
    capture = read_capture(folder, kinds=["composite", "white"], with_truth=False)
    assert capture.plan.names == ("white", "composite")
    assert set(capture.images["right"]) == {"white", "composite"}
    assert capture.image_size == (16, 12)
    with pytest.raises(CaptureError, match="nstep needs the pattern groups gray, high, which the capture lacks"):
        capture.require(["gray", "high", "white"], "nstep")


def test_nothing_loaded_is_said_in_words(folder):
    empty = read_capture(folder, kinds=[])
    with pytest.raises(CaptureError, match="no images were loaded"):
        _ = empty.image_size


def test_stacks_are_scaled_to_the_white_level(tmp_path):
    capture = make_capture(dtype=np.uint16, record=CaptureRecord(bit_depth=16, white_level=4000))
    stack = capture.stack("left", "high")
    assert (stack.dtype, stack.shape) == (np.float32, (3, *SIZE))
    np.testing.assert_allclose(stack[1], capture.images["left"]["high_01"] / 4000, rtol=1e-6)
    with pytest.raises(CaptureError, match="has no 'gray_inv' images"):
        capture.stack("left", "gray_inv")


def test_one_view_is_a_capture_until_two_are_needed(tmp_path):
    write_capture(make_capture(sides=("left",)), tmp_path / "scene")
    capture = read_capture(tmp_path / "scene")
    assert capture.sides == ("left",)
    with pytest.raises(CaptureError, match="matching needs two views"):
        capture.require_two_views("matching")


def test_a_lost_view_that_was_recorded_is_damage(tmp_path):
    record = CaptureRecord.model_validate({"devices": [{"role": "right", "driver": "replay"}]})
    write_capture(make_capture(record=record), tmp_path / "scene")
    for image in (tmp_path / "scene" / "right").iterdir():
        image.unlink()
    (tmp_path / "scene" / "right").rmdir()
    with pytest.raises(CaptureError, match=r"lacks right/white\.png"):
        read_capture(tmp_path / "scene")


# Without capture.json


def test_default_parameters_hold_without_a_record(folder):
    (folder / "capture.json").unlink()
    (folder / "left" / "notes.txt").write_text("x")
    (folder / "left" / "overview.png").write_bytes(b"x")
    (folder / "right" / "Thumbs.db").write_bytes(b"x")
    capture = read_capture(folder)
    plan = make_plan("full", FringeParameters(exposure_us=capture.plan.patterns[0].exposure_us))
    assert capture.plan.patterns == plan.patterns
    assert capture.rig is None
    assert (capture.record.id, capture.white_level) == ("scene", 255)


def test_the_depth_of_the_images_counts_where_the_record_states_none(tmp_path):
    write_capture(make_capture(make_plan("full"), dtype=np.uint16), tmp_path / "scene")
    path = tmp_path / "scene" / "capture.json"
    record = json.loads(path.read_text())
    del record["bit_depth"]
    path.write_text(json.dumps(record))
    assert read_capture(tmp_path / "scene").white_level == 65535
    path.unlink()
    assert read_capture(tmp_path / "scene").white_level == 65535


@pytest.mark.parametrize(
    ("victims", "named"),
    [
        (["left/high_04.png"], r"lacks left/high_04\.png"),
        (["right/low_13.png"], r"lacks right/low_13\.png"),
        (["left/gray_00.png", "right/gray_00.png"], r"left/gray_00\.png, right/gray_00\.png"),
        (["left/high_08.png", "right/high_08.png"], r"left/high_08\.png, right/high_08\.png"),
        (["left/composite.png"], r"lacks left/composite\.png"),
        ([f"left/high_{k:02d}.png" for k in range(9)], r"lacks left/high_00\.png.*and 5 more"),
    ],
)
@pytest.mark.parametrize("recorded", [True, False])
def test_a_group_that_is_partly_present_is_damage(folder, victims, named, recorded):
    if not recorded:
        (folder / "capture.json").unlink()
    for victim in victims:
        (folder / victim).unlink()
    with pytest.raises(CaptureError, match=f"damaged capture: .*{named}") as caught:
        read_capture(folder)
    assert str(folder) in str(caught.value)


def test_whole_groups_may_be_absent_without_a_record(folder):
    (folder / "capture.json").unlink()
    for path in [*folder.glob("*/high_*.png"), *folder.glob("*/gray_*.png"), *folder.glob("*/composite.png")]:
        path.unlink()
    assert read_capture(folder).plan.kinds == {"white", "low", "black"}


def test_more_steps_than_the_defaults_need_a_record(folder):
    (folder / "capture.json").unlink()
    (folder / "left" / "high_09.png").write_bytes((folder / "left" / "high_08.png").read_bytes())
    with pytest.raises(CaptureError, match=r"high_09.*capture\.json"):
        read_capture(folder)


@pytest.mark.parametrize("recorded", [True, False])
def test_an_empty_folder_is_no_capture(tmp_path, recorded):
    (tmp_path / "scene" / "left").mkdir(parents=True)
    if recorded:
        (tmp_path / "scene" / "capture.json").write_text('{"schema": "capture/1"}')
    with pytest.raises(CaptureError, match="scene: has neither"):
        read_capture(tmp_path / "scene")
    with pytest.raises(CaptureError, match="is not a folder"):
        read_capture(tmp_path / "other")


# Damaged images


@pytest.mark.parametrize("keep", [0, 4, 60, 0.5, 0.9, -1])
def test_truncated_images_are_named(folder, keep):
    path = folder / "right" / "low_03.png"
    data = path.read_bytes()
    path.write_bytes(data[: keep if isinstance(keep, int) else int(keep * len(data))])
    with pytest.raises(CaptureError, match=r"right/low_03\.png: not a whole PNG"):
        read_capture(folder)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_flipped_byte_is_found(folder, data):
    path = folder / "left" / "white.png"
    whole = path.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    damaged = bytearray(whole)
    damaged[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(damaged)
    try:
        with pytest.raises(CaptureError, match=r"white\.png: not a whole PNG"):
            read_capture(folder, kinds=["white"])
    finally:
        path.write_bytes(whole)


def _replace(folder: Path, name: str, image: np.ndarray, suffix: str = ".png") -> None:
    (folder / name).write_bytes(cv2.imencode(suffix, image)[1].tobytes())


@pytest.mark.parametrize(
    ("image", "suffix", "named"),
    [
        (np.zeros((*SIZE, 3), np.uint8), ".png", r"white\.png: has 3 channels"),
        (np.zeros((*SIZE, 4), np.uint8), ".png", r"white\.png: has 4 channels"),
        (np.zeros((10, 16), np.uint8), ".png", "is 16x12 but white.png is 16x10"),
        (np.zeros(SIZE, np.uint16), ".png", "mixes 8-bit and 16-bit"),
        (np.zeros(SIZE, np.uint8), ".jpg", "not a whole PNG"),
    ],
)
def test_images_that_do_not_belong_are_named(folder, image, suffix, named):
    _replace(folder, "left/white.png", image, suffix)
    with pytest.raises(CaptureError, match=named) as caught:
        read_capture(folder)
    assert str(folder) in str(caught.value)


def test_a_folder_in_the_place_of_an_image_is_missing(folder):
    (folder / "left" / "white.png").unlink()
    (folder / "left" / "white.png").mkdir()
    with pytest.raises(CaptureError, match=r"lacks left/white\.png"):
        read_capture(folder)


# Damaged records


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"schema": "capture/2"}', b'{"bit_depth": 17}'],
)
def test_a_bad_record_is_named(folder, content):
    (folder / "capture.json").write_bytes(content)
    with pytest.raises(CaptureError, match=r"capture\.json") as caught:
        read_capture(folder)
    assert "\n" not in str(caught.value)


def _edit(folder: Path, **changes) -> None:
    path = folder / "capture.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"bit_depth": 12}, "bit_depth is 12 but the images have 8 bits"),
        ({"bit_depth": 4}, r"reaches \d+ but bit_depth is 4"),
        ({"white_level": 0}, "white_level"),
        ({"created": "yesterday"}, "created"),
        ({"patterns": [{"name": "../../x", "kind": "white"}]}, r"patterns\.0\.name"),
        ({"patterns": [{"name": "white", "kind": "white"}] * 2}, "stands twice"),
        ({"patterns": [{"name": "a", "kind": "high", "period": 9, "step": 0, "steps": 10**9}]}, "steps"),
        ({"calibration": {"schema": "rig-calibration/1", "left": 3, "right": 4}}, "'left'"),
        ({"frame_ids": {"middle": [1]}}, "frame_ids"),
    ],
)
def test_a_record_that_cannot_be_is_named(folder, changes, named):
    _edit(folder, **changes)
    with pytest.raises(CaptureError, match=named) as caught:
        read_capture(folder)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_damage_to_the_record_is_an_error_in_words_or_harmless(folder, data):
    path = folder / "capture.json"
    whole = path.read_text()
    record = json.loads(whole)
    target = record
    for _ in range(data.draw(st.integers(0, 3))):
        values = target.values() if isinstance(target, dict) else target
        inner = [v for v in values if v and isinstance(v, dict | list)]
        target = data.draw(st.sampled_from(inner)) if inner else target
    keys = list(target) if isinstance(target, dict) else range(len(target))
    target[data.draw(st.sampled_from(keys))] = data.draw(JSON)
    path.write_text(json.dumps(record))
    message = ""
    try:
        read_capture(folder, kinds=["composite"])
    except DuofringeError as error:
        message = str(error)
    finally:
        path.write_text(whole)
    assert "\n" not in message


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=80))
def test_any_bytes_in_place_of_the_record_are_an_error_in_words(folder, content):
    whole = (folder / "capture.json").read_bytes()
    (folder / "capture.json").write_bytes(content)
    try:
        with pytest.raises(CaptureError, match=r"capture\.json"):
            read_capture(folder)
    finally:
        (folder / "capture.json").write_bytes(whole)


# Damaged truth


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("depth", None, r"depth\.npy: truth is not readable"),
        ("depth", b"", r"depth\.npy: truth is not readable"),
        ("depth", np.zeros((3, 3)), "differ in size"),
        ("projector_column", np.array([["a"]]), r"projector_column\.npy: truth is not an array of numbers"),
        ("lit", np.array([{}]), r"lit\.npy: truth is not readable"),
    ],
)
def test_damaged_truth_is_named(tmp_path, name, content, named):
    plane = np.ones(SIZE, np.float32)
    truth = Truth(plane, plane, plane > 0, {"lit": plane})
    write_capture(make_capture(truth=truth), tmp_path / "scene")
    path = tmp_path / "scene" / "truth" / f"{name}.npy"
    path.unlink()
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        np.save(path, content, allow_pickle=True)
    with pytest.raises(CaptureError, match=named):
        read_capture(tmp_path / "scene")
    assert read_capture(tmp_path / "scene", with_truth=False).truth is None


def test_truth_of_another_size_than_the_images_is_refused(tmp_path):
    plane = np.ones((4, 4), np.float32)
    write_capture(make_capture(truth=Truth(plane, plane, plane > 0)), tmp_path / "scene")
    with pytest.raises(CaptureError, match="differ in size"):
        read_capture(tmp_path / "scene")
