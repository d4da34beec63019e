"""Foreign sets: each key of a manifest, and the two recorded sets."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from foreign_sets import (
    BITS,
    COLUMN,
    HEIGHT,
    PERIOD,
    PLAIN,
    STEPS,
    WIDTH,
    assert_columns,
    decoded_order,
    decoded_phase,
    fringe,
    gray_plane,
    toml,
    write,
    write_plain_set,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from models.capture import read_capture, write_capture
from models.errors import CalibrationError, ManifestError
from models.foreign import Manifest, import_capture

EXAMPLES = Path(__file__).parent.parent / "examples" / "manifests"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_plain_set(tmp_path / "set")
    return tmp_path / "set"


class TestPlainSet:
    def test_becomes_a_capture_with_our_names(self, folder: Path, tmp_path: Path) -> None:
        capture = import_capture(folder, toml(tmp_path / "m.toml", PLAIN))
        assert capture.plan.names == (
            "white",
            *(f"high_{k:02d}" for k in range(5)),
            *(f"gray_{b:02d}" for b in range(3)),
            "black",
        )
        assert capture.sides == ("left",)
        assert_columns(capture)

    def test_written_and_read_back_it_is_the_same(self, folder: Path, tmp_path: Path) -> None:
        capture = import_capture(folder, toml(tmp_path / "m.toml", 'object_id = "vase"\n' + PLAIN))
        write_capture(capture, tmp_path / "capture")
        again = read_capture(tmp_path / "capture")
        assert again.plan == capture.plan
        assert again.record.object_id == "vase"
        for name, image in capture.images["left"].items():
            assert np.array_equal(again.images["left"][name], image)

    def test_the_record_tells_where_it_came_from(self, folder: Path, tmp_path: Path) -> None:
        record = import_capture(folder, toml(tmp_path / "m.toml", PLAIN)).record
        assert [d.origin for d in record.devices] == ["imported"]
        source = record.settings["import"]
        assert source["files"]["left"]["gray_02"] == "08.png"
        assert len(source["manifest_sha256"]) == 64
        assert record.id == "set"


class TestConventions:
    @given(
        steps=st.integers(3, 9),
        period=st.floats(8.0, 30.0),
        sign=st.sampled_from([1, -1]),
        offset=st.floats(-math.pi, math.pi),
    )
    @settings(max_examples=25, deadline=None)
    def test_sign_offset_and_period_travel_to_the_decoder(
        self, tmp_path_factory: pytest.TempPathFactory, steps: int, period: float, sign: int, offset: float
    ) -> None:
        root = tmp_path_factory.mktemp("set")
        for k in range(steps):
            write(root / f"{k}.png", fringe(k, steps=steps, period=period, sign=sign, offset=offset))
        text = f'[high]\nfiles = "{{n}}.png"\nsteps = {steps}\nperiod = {period!r}\n'
        text += f"shift_sign = {sign}\nphase_offset = {offset!r}\n"
        assert_columns(import_capture(root, toml(root / "m.toml", text)), period=period)

    def test_shifts_in_any_order_with_any_start(self, tmp_path: Path) -> None:
        shifts = [100.0, 10.0, -80.0, 190.0]
        for k, shift in enumerate(shifts):
            write(tmp_path / f"{k}.png", 110 + 90 * np.cos(2 * np.pi * COLUMN / PERIOD + math.radians(shift)))
        text = f'[high]\nfiles = "{{n}}.png"\nsteps = 4\nperiod = 12.0\nshift_sign = -1\nshifts_deg = {shifts}\n'
        assert_columns(import_capture(tmp_path, toml(tmp_path / "m.toml", text)))

    def test_least_significant_bit_first(self, folder: Path, tmp_path: Path) -> None:
        for bit in range(BITS):
            write(folder / f"{6 + bit:02d}.png", gray_plane(BITS - 1 - bit))
        assert_columns(
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN + 'bit_order = "lsb_first"\n')),
        )

    def test_code_one_bit_finer_than_the_fringe(self, folder: Path, tmp_path: Path) -> None:
        for bit in range(4):
            write(folder / f"g{bit}.png", gray_plane(bit, bits=4, period=PERIOD / 2))
        text = PLAIN.partition("[gray]")[0] + '[gray]\nfiles = "g{n}.png"\nbits = 4\nperiod = 6.0\n'
        assert_columns(import_capture(folder, toml(tmp_path / "m.toml", text)), order_period=6.0)

    @pytest.mark.parametrize("with_inverse", [False, True])
    def test_inverted_polarity_is_put_right(self, folder: Path, tmp_path: Path, with_inverse: bool) -> None:
        for bit in range(BITS):
            write(folder / f"i{bit}.png", gray_plane(bit))
            write(folder / f"{6 + bit:02d}.png", 220 - gray_plane(bit))
        text = PLAIN + 'polarity = "inverted"\n' + ('inverse_files = "i{n}.png"\n' if with_inverse else "")
        capture = import_capture(folder, toml(tmp_path / "m.toml", text))
        assert bool(capture.plan.of_kind("gray_inv")) == with_inverse
        assert_columns(capture)
        if with_inverse:
            normal, inverse = capture.stack("left", "gray"), capture.stack("left", "gray_inv")
            assert np.array_equal(normal > 0.5, inverse < 0.5)

    def test_inverse_planes_follow_the_bit_order(self, folder: Path, tmp_path: Path) -> None:
        for bit in range(BITS):
            write(folder / f"{6 + bit:02d}.png", gray_plane(BITS - 1 - bit))
            write(folder / f"i{bit + 3}.png", 220 - gray_plane(BITS - 1 - bit))
        text = PLAIN + 'bit_order = "lsb_first"\ninverse_files = "i{n}.png"\ninverse_first = 3\n'
        capture = import_capture(folder, toml(tmp_path / "m.toml", text))
        assert_columns(capture)
        assert np.array_equal(capture.stack("left", "gray") > 0.5, capture.stack("left", "gray_inv") < 0.5)

    def test_two_carriers_and_a_composite(self, folder: Path, tmp_path: Path) -> None:
        for k in range(4):
            write(folder / f"low{k}.png", fringe(k, steps=4, period=20.0, offset=0.3))
        write(folder / "both.png", 0.5 * (fringe(0) + fringe(0, period=20.0, offset=0.3)))
        text = PLAIN + '[low]\nfiles = "low{n}.png"\nsteps = 4\nperiod = 20.0\nphase_offset = 0.3\n'
        text += '[composite]\nfile = "both.png"\n'
        capture = import_capture(folder, toml(tmp_path / "m.toml", text))
        (composite,) = capture.plan.of_kind("composite")
        assert composite.periods == (12.0, 20.0)
        assert composite.phase_offsets == (0.0, 0.3)
        assert np.corrcoef(composite.evaluate(COLUMN).ravel(), capture.images["left"]["composite"].ravel())[0, 1] > 0.99
        low_error = np.angle(np.exp(1j * (decoded_phase(capture, "low") - 2 * np.pi * COLUMN / 20.0)))
        assert np.abs(low_error).max() < 0.02

    def test_a_composite_alone(self, tmp_path: Path) -> None:
        write(tmp_path / "shot.png", fringe(0))
        text = '[composite]\nfile = "shot.png"\nperiods = [9.0, 14.0]\nphase_offsets = [0.1, 0.2]\n'
        (pattern,) = import_capture(tmp_path, toml(tmp_path / "m.toml", text)).plan.patterns
        assert (pattern.periods, pattern.phase_offsets) == ((9.0, 14.0), (0.1, 0.2))


class TestFiles:
    def test_two_views_by_word_and_by_table(self, tmp_path: Path) -> None:
        for k in range(STEPS):
            write(tmp_path / "cam1" / f"{k}.png", fringe(k))
            write(tmp_path / "cam0" / f"{k}.png", fringe(k, offset=1.0))
        write(tmp_path / "a.png", fringe(0))
        write(tmp_path / "b.png", fringe(1))
        text = '[views]\nleft = "cam1"\nright = "cam0"\n[white]\nfile = { left = "a.png", right = "b.png" }\n'
        text += '[high]\nfiles = "{view}/{n}.png"\nsteps = 5\nperiod = 12.0\n'
        capture = import_capture(tmp_path, toml(tmp_path / "m.toml", text))
        assert capture.sides == ("left", "right")
        assert capture.record.settings["import"]["files"]["right"]["white"] == "b.png"
        assert_columns(capture)
        shift = np.angle(np.exp(1j * (decoded_phase(capture) - decoded_phase(capture, side="right"))))
        assert np.abs(shift - 1.0).max() < 0.04

    def test_a_list_of_names_and_a_stride(self, tmp_path: Path) -> None:
        names = ["e", "c", "a", "d", "b"]
        for k, name in enumerate(names):
            write(tmp_path / f"{name}.png", fringe(k))
            write(tmp_path / f"{10 - 2 * k}.png", fringe(k))
        listed = f"[high]\nfiles = {[f'{n}.png' for n in names]}\nsteps = 5\nperiod = 12.0\n"
        counted = '[high]\nfiles = "{n}.png"\nfirst = 10\nstride = -2\nsteps = 5\nperiod = 12.0\n'
        for text in (listed, counted):
            assert_columns(import_capture(tmp_path, toml(tmp_path / "m.toml", text)))

    def test_a_sequence_known_by_its_order_alone(self, tmp_path: Path) -> None:
        images = [np.zeros_like(COLUMN), np.full_like(COLUMN, 200.0)]
        for bit in range(BITS):
            images += [gray_plane(bit), 220 - gray_plane(bit)]
        images += [fringe(k) for k in range(STEPS)]
        for index, image in enumerate(images):  # shot9 comes before shot10 only in natural order
            write(tmp_path / "cam" / f"shot{index + 5}.bmp", image)
        text = '[sequence]\nfiles = "cam/*.bmp"\norder = ["skip", "white", "gray_00", "gray_inv_00", "gray_01", '
        text += '"gray_inv_01", "gray_02", "gray_inv_02", "high"]\n[high]\nsteps = 5\nperiod = 12.0\n[gray]\nbits = 3\n'
        capture = import_capture(tmp_path, toml(tmp_path / "m.toml", text))
        assert_columns(capture)
        assert capture.record.settings["import"]["files"]["left"]["white"] == "cam/shot6.bmp"

    @pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "jpg"])
    def test_formats(self, tmp_path: Path, suffix: str) -> None:
        for k in range(STEPS):
            write(tmp_path / f"{k}.{suffix}", fringe(k))
        text = f'[high]\nfiles = "{{n}}.{suffix}"\nsteps = 5\nperiod = 12.0\n'
        assert_columns(import_capture(tmp_path, toml(tmp_path / "m.toml", text)))

    @pytest.mark.parametrize(
        ("scale", "keys", "white"), [(16, "bit_depth = 12", 4095), (256, "bit_depth = 12\nwhite_level = 65280", 65280)]
    )
    def test_sixteen_bit_files(self, tmp_path: Path, scale: int, keys: str, white: int) -> None:
        for k in range(STEPS):
            write(tmp_path / f"{k}.tif", fringe(k), scale=scale, dtype=np.uint16)
        text = f'[images]\n{keys}\n[high]\nfiles = "{{n}}.tif"\nsteps = 5\nperiod = 12.0\n'
        capture = import_capture(tmp_path, toml(tmp_path / "m.toml", text))
        assert capture.white_level == white
        assert_columns(capture)
        assert 0.7 < capture.stack("left", "high").max() < 0.85

    @pytest.mark.parametrize("channel", ["red", "green", "blue"])
    def test_one_channel_of_colour_images(self, tmp_path: Path, channel: str) -> None:
        for k in range(STEPS):
            image = np.full((HEIGHT, WIDTH, 4), 7.0)
            image[..., ["blue", "green", "red"].index(channel)] = fringe(k)
            write(tmp_path / f"{k}.png", image)
        text = f'[images]\nchannel = "{channel}"\n[high]\nfiles = "{{n}}.png"\nsteps = 5\nperiod = 12.0\n'
        assert_columns(import_capture(tmp_path, toml(tmp_path / "m.toml", text)))

    def test_grey_pictures_in_colour_files_keep_their_values(self, tmp_path: Path) -> None:
        ramp = np.broadcast_to(np.arange(WIDTH, dtype=float)[:, None], (HEIGHT, WIDTH, 3))
        write(tmp_path / "shot.png", ramp)
        text = '[composite]\nfile = "shot.png"\nperiods = [9.0, 14.0]\n'
        image = import_capture(tmp_path, toml(tmp_path / "m.toml", text)).images["left"]["composite"]
        assert np.array_equal(image, ramp[..., 0])


CAMERA = np.array([[100.0, 0, 48], [0, 100, 2], [0, 0, 1]])


def write_storage(path: Path, fields: Mapping[str, Any]) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in fields.items():
        storage.write(name, value)
    storage.release()


class TestCalibration:
    intrinsics: Mapping[str, Any] = {"camL": CAMERA, "D1": np.zeros(5), "M2": CAMERA, "D2": np.zeros(5)}
    extrinsics: Mapping[str, Any] = {"R": np.eye(3), "T": np.array([-0.12, 0.0, 0.0])}
    text = '[calibration]\nfiles = ["in.yml", "ex.yml"]\nunits = "m"\n[calibration.fields]\nleft_matrix = "camL"\n'

    def test_opencv_files_with_own_names_and_metres(self, folder: Path, tmp_path: Path) -> None:
        write_storage(folder / "in.yml", self.intrinsics)
        write_storage(folder / "ex.yml", self.extrinsics)
        rig = import_capture(folder, toml(tmp_path / "m.toml", PLAIN + self.text)).rig
        assert rig is not None
        assert rig.left.size == (WIDTH, HEIGHT)
        assert np.allclose(rig.right.centre, [120.0, 0, 0])

    def test_our_own_file(self, folder: Path, tmp_path: Path) -> None:
        write_storage(folder / "in.yml", self.intrinsics)
        write_storage(folder / "ex.yml", self.extrinsics)
        rig = import_capture(folder, toml(tmp_path / "m.toml", PLAIN + self.text)).rig
        assert rig is not None
        rig.to_file(folder / "calibration.json")
        text = PLAIN + '[calibration]\nfiles = ["calibration.json"]\n'
        again = import_capture(folder, toml(tmp_path / "m.toml", text)).rig
        assert again is not None
        assert again.to_dict()["right"] == rig.to_dict()["right"]

    @pytest.mark.parametrize(
        ("change", "fault"),
        [
            (lambda t: t.replace('"ex.yml"', '"gone.yml"'), "gone.yml"),
            (lambda t: t.replace('"camL"', '"cameraLeft"'), "left_matrix"),
            (lambda t: t.replace("left_matrix", "left_lens"), "left_lens"),
            (lambda t: t.replace("[calibration.fields]", "size = [64, 48]\n[calibration.fields]"), "64x48"),
        ],
    )
    def test_mistakes_are_named(self, folder: Path, tmp_path: Path, change: Callable[[str], str], fault: str) -> None:
        write_storage(folder / "in.yml", self.intrinsics)
        write_storage(folder / "ex.yml", self.extrinsics)
        with pytest.raises((ManifestError, CalibrationError), match=fault):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN + change(self.text)))


@pytest.mark.realdata
class TestRecordedSets:
    def test_stereo_set_has_one_absolute_column(self, real_data: Path) -> None:
        """Gray words and phase agree, and the column rises along the rows without jumps of a fringe."""
        capture = import_capture(real_data / "stereo_small_mit", EXAMPLES / "stereo_small_mit.toml")
        assert capture.image_size == (1280, 1024)
        assert capture.rig is not None
        assert np.allclose(np.linalg.norm(capture.rig.right.centre), 120.97, atol=0.01)
        for side in capture.sides:
            white, black = capture.stack(side, "white")[0], capture.stack(side, "black")[0]
            phase = decoded_phase(capture, side=side) % (2 * np.pi)
            word = decoded_order(capture, side, (white + black) / 2)  # type: ignore[arg-type]
            lit = (np.ptp(capture.stack(side, "high"), axis=0) > 30 / 255) & (white - black > 30 / 255)
            # A word is half a fringe: even words lie in its first half.
            assert np.mean(((phase >= np.pi) == (word & 1))[lit]) > 0.95
            fringe_order = np.round((word + 0.5) / 2 - phase / (2 * np.pi))
            column = 32 * (fringe_order + phase / (2 * np.pi))
            step = np.diff(column, axis=1)[lit[:, 1:] & lit[:, :-1]]
            assert np.mean(step > 0) > 0.998
            assert np.mean(np.abs(step) > 8) < 2e-4

    @pytest.mark.parametrize("scene", ["plane", "object"])
    def test_composite_set_matches_its_carriers(self, real_data: Path, scene: str) -> None:
        """Both phases rise along the rows at the stated periods, agree in the ratio 6, and make up the composite."""
        capture = import_capture(real_data / "composite_fringe", EXAMPLES / f"composite_fringe_{scene}.toml")
        assert capture.sides == ("left",)
        phases = {kind: decoded_phase(capture, kind) for kind in ("high", "low")}
        lit = np.ptp(capture.stack("left", "high"), axis=0) > 40 / 255
        for kind, phase in phases.items():
            (period,) = capture.plan.of_kind(kind)[0].periods  # type: ignore[arg-type]
            slope = np.angle(np.exp(1j * np.diff(phase, axis=1)))[lit[:, 1:]]
            assert np.median(slope) == pytest.approx(2 * np.pi / period, rel=0.01)
        disagreement = np.angle(np.exp(1j * (phases["high"] - 6 * phases["low"])))[lit]
        assert np.median(np.abs(disagreement)) < 0.08
        waves = np.stack([np.ones(lit.sum()), np.cos(phases["high"][lit]), np.cos(phases["low"][lit])])
        composite = capture.stack("left", "composite")[0][lit]
        coefficients, *_ = np.linalg.lstsq(waves.T, composite, rcond=None)
        assert coefficients[1] > 0.05
        assert coefficients[2] > 0.05


@pytest.mark.parametrize("name", ["stereo_small_mit", "composite_fringe_object"])
def test_the_guide_shows_the_example_manifests_as_they_are(name: str) -> None:
    guide = (EXAMPLES.parent.parent / "docs" / "foreign-captures.md").read_text(encoding="utf-8")
    shown = [tomllib.loads(block) for block in re.findall(r"```toml\n(schema.*?)```", guide, re.DOTALL)]
    assert tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")) in shown


@pytest.mark.parametrize("table", [Manifest, *(f.annotation for f in Manifest.model_fields.values())])
def test_the_guide_lists_every_key(table: Any) -> None:
    guide = (EXAMPLES.parent.parent / "docs" / "foreign-captures.md").read_text(encoding="utf-8")
    for model in [table, *get_args(table)]:
        for key, field in getattr(model, "model_fields", {}).items():
            assert f"`{field.alias or key}`" in guide or f"`[{key}]`" in guide, key
