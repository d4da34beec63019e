"""Mistakes in manifests and sets: each is one line that names the file and the key at fault."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foreign_sets import PLAIN, fringe, toml, write, write_plain_set
from hypothesis import assume, given
from hypothesis import strategies as st

from models.errors import ManifestError
from models.foreign import import_capture
from models.foreign.files import fill_template


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_plain_set(tmp_path / "set")
    return tmp_path / "set"


def put(old: str, new: str) -> Callable[[str], str]:
    assert old in PLAIN
    return lambda text: text.replace(old, new, 1)


class TestMistakes:
    """Each mistake is one line that names the file and the key at fault."""

    @pytest.mark.parametrize(
        ("change", "fault"),
        [
            (put("steps = 5", "stepps = 5"), "high.stepps: unknown key"),
            (put("steps = 5\n", ""), "high.steps: is required"),
            (put("steps = 5", "steps = 2"), "high.steps"),
            (put("steps = 5", "steps = 5.0"), "high.steps"),
            (put("steps = 5", "steps = 6\nshift_sign = 2"), "high.shift_sign"),
            (put("steps = 5", "steps = 8"), "'06.png' is both high_05 and gray_00"),
            (put("period = 12.0", "period = 0"), "high.period"),
            (put("period = 12.0", "period = nan"), "high.period"),
            (put("period = 12.0", 'period = "12"'), "high.period"),
            (put("period = 12.0", "period = 12.0\nphase_offset = inf"), "high.phase_offset"),
            (put("period = 12.0", "period = 12.0\nstride = 0"), "stride is 0"),
            (put("period = 12.0", "period = 12.0\nstride = -1"), "number -3 is negative"),
            (put("period = 12.0", "period = 12.0\nshifts_deg = [0, 72, 144, 216]"), "4 values but steps is 5"),
            (put("period = 12.0", "period = 12.0\nshifts_deg = [0, 90, 180, 270, 360]"), "not uniform"),
            (put("bits = 3", "bits = 17"), "gray.bits"),
            (put("bits = 3", 'bits = 3\nbit_order = "lsb"'), "gray.bit_order"),
            (put('"{n:02}.png"', '"{m}.png"'), r"\{m\}"),
            (put('"{n:02}.png"', '"{n.__class__}.png"'), "__class__"),
            (put('"{n:02}.png"', '"01.png"'), "lacks {n}"),
            (put('"{n:02}.png"', '["01.png", "02.png"]'), "lists 2 files but the group has 5"),
            (put('"{n:02}.png"', "7"), "high.files: expected a file name"),
            (put('"{n:02}.png"', '{ top = "{n}.png" }'), "left and right"),
            (put('"{n:02}.png"', '{ right = "{n}.png" }'), "no files for the left view"),
            (put('"{n:02}.png"', '"../set/{n:02}.png"'), "stay inside"),
            (put('"{n:02}.png"', '"/etc/{n:02}.png"'), "stay inside"),
            (put('"00.png"', '"white.png"'), "white: file .*white.png' does not exist"),
            (put('"00.png"', '"' + "x" * 300 + '.png"'), "white: file"),
            (put('file = "00.png"\n', ""), "white: has no files"),
            (put("[white]", "[sequence]\nfiles='*'\norder=['white']\n[white]"), "white: has files and stands in"),
            (put("[white]", "[sequence]\nfiles='*'\norder=['low']\n[white]"), "'low' is neither"),
            (put("[white]", "[sequence]\nfiles='*'\norder=['gray_00']\n[white]"), "gray must stand there once"),
            (put("[high]", "[images]\nchannel = 'red'\n[high]"), "has one channel"),
            (put("[high]", "[images]\nbit_depth = 12\n[high]"), "bit_depth is 12 but the files have 8 bits"),
            (put("[high]", "[images]\nchannel = 'infrared'\n[high]"), "images.channel"),
            (put("[high]", "[composite]\nfile = '00.png'\n[high]"), "composite.periods is required"),
            (put("[high]", "[low]"), "low stands without high"),
            (put("[gray]", "[graycode]"), "graycode: unknown key"),
        ],
    )
    def test_in_the_manifest(self, folder: Path, tmp_path: Path, change: Callable[[str], str], fault: str) -> None:
        with pytest.raises(ManifestError, match=fault) as caught:
            import_capture(folder, toml(tmp_path / "m.toml", change(PLAIN)))
        assert "\n" not in str(caught.value)

    def test_a_missing_step_is_named(self, folder: Path, tmp_path: Path) -> None:
        (folder / "03.png").unlink()
        with pytest.raises(ManifestError, match=r"high_02: file '.*03.png' does not exist"):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN))

    @pytest.mark.parametrize(
        ("content", "fault"),
        [(b"", "is empty"), (b"not an image", "not a readable"), (None, "truncated")],
        ids=["empty", "text", "truncated"],
    )
    def test_a_damaged_image_is_named(self, folder: Path, tmp_path: Path, content: bytes | None, fault: str) -> None:
        path = folder / "07.png"
        path.write_bytes(path.read_bytes()[:-20] if content is None else content)
        with pytest.raises(ManifestError, match=f"07.png.*{fault}"):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN))

    def test_an_image_of_another_size_is_named(self, folder: Path, tmp_path: Path) -> None:
        write(folder / "04.png", fringe(3)[:, :-1])
        with pytest.raises(ManifestError, match=r"04.png: is 95x4 uint8 but 00.png is 96x4"):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN))

    def test_float_images_are_refused(self, folder: Path, tmp_path: Path) -> None:
        write(folder / "00.tif", fringe(0), dtype=np.float32)
        with pytest.raises(ManifestError, match=r"00.tif: has float32 pixels"):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN.replace('"00.png"', '"00.tif"')))

    def test_sixteen_bits_must_be_told(self, tmp_path: Path) -> None:
        write(tmp_path / "shot.png", fringe(0), scale=200, dtype=np.uint16)
        text = '[composite]\nfile = "shot.png"\nperiods = [9.0, 14.0]\n'
        with pytest.raises(ManifestError, match=r"images.bit_depth is required"):
            import_capture(tmp_path, toml(tmp_path / "m.toml", text))
        with pytest.raises(ManifestError, match="bit_depth is 12 but a pixel reads"):
            import_capture(tmp_path, toml(tmp_path / "m.toml", text + "[images]\nbit_depth = 12\n"))

    def test_inverted_planes_without_a_reference_are_refused(self, folder: Path, tmp_path: Path) -> None:
        text = PLAIN.partition("[black]")[0] + "[high]" + PLAIN.partition("[high]")[2] + 'polarity = "inverted"\n'
        with pytest.raises(ManifestError, match=r"gray.polarity"):
            import_capture(folder, toml(tmp_path / "m.toml", text))

    def test_links_out_of_the_folder_are_refused(self, folder: Path, tmp_path: Path) -> None:
        write(tmp_path / "outside.png", fringe(0))
        (folder / "02.png").unlink()
        (folder / "02.png").symlink_to(tmp_path / "outside.png")
        with pytest.raises(ManifestError, match="leads out of"):
            import_capture(folder, toml(tmp_path / "m.toml", PLAIN))

    def test_a_sequence_of_another_length_is_counted(self, folder: Path, tmp_path: Path) -> None:
        text = '[sequence]\nfiles = "*.png"\norder = ["white", "high"]\n[high]\nsteps = 5\nperiod = 12.0\n'
        with pytest.raises(ManifestError, match=r"matches 10 files in '.*set' but sequence.order describes 6"):
            import_capture(folder, toml(tmp_path / "m.toml", text))

    @pytest.mark.parametrize(
        "text", ["[high", "a = [" * 5000, "n = " + "9" * 5000, "\x00"], ids=["syntax", "deep", "digits", "binary"]
    )
    def test_text_that_is_not_toml(self, folder: Path, tmp_path: Path, text: str) -> None:
        path = tmp_path / "m.toml"
        path.write_text(text)
        with pytest.raises(ManifestError, match=r"m.toml: not valid TOML"):
            import_capture(folder, path)

    def test_missing_folder_and_manifest(self, folder: Path, tmp_path: Path) -> None:
        with pytest.raises(ManifestError, match="is not a folder"):
            import_capture(tmp_path / "gone", tmp_path / "m.toml")
        with pytest.raises(ManifestError, match="does not exist"):
            import_capture(folder, tmp_path / "m.toml")

    @given(st.text(st.characters(exclude_characters="{}"), max_size=40).filter(lambda t: t not in ("view", "n")))
    def test_braces_hold_nothing_but_view_and_number(self, content: str) -> None:
        assume(re.fullmatch(r"n(:0[1-9]d?)?", content) is None)
        with pytest.raises(ManifestError, match="is not one of"):
            fill_template(f"image_{{{content}}}.png", "left", 7)
