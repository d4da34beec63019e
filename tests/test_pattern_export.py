"""What ``patterns export`` writes, read back by other eyes than those that wrote it."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.lightcrafter import planes
from drivers.lightcrafter.bitmaps import read_bitmap, write_image
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.sequence import VIDEO_FRAME_US
from drivers.lightcrafter.splash import FirmwareError
from models.patterns import LIGHTCRAFTER_4500, PLAN_NAMES, Pattern, make_plan
from service.flash_images import read_flash_images
from service.pattern_images import combined_plan
from service.video_frames import VideoManifest, pack_frames

Run = Callable[..., tuple[int, str, str]]
Pixels = np.ndarray


def bitmap(path: Path) -> Pixels:
    """(rows, columns, 3) blue, green, red, top row first, of a BMP whose header says what the projector takes."""
    data = path.read_bytes()
    magic, size, _, _, at = struct.unpack_from("<2sIHHI", data)
    head, columns, rows, layers, bits, compression = struct.unpack_from("<IiiHHI", data, 14)
    assert (magic, size, head, layers, bits, compression) == (b"BM", len(data), 40, 1, 24, 0)
    assert (columns, rows) == (912, 1140), "rows are positive: the last comes first"
    assert len(data) == at + 3 * 912 * 1140
    return np.frombuffer(data, np.uint8, offset=at).reshape(1140, 912, 3)[::-1]


def png(path: Path) -> Pixels:
    """(rows, columns, 3) red, green, blue of a 24-bit PNG."""
    chunks = dict(_chunks(path.read_bytes()))
    columns, rows, bits, kind, *rest = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert (columns, rows, bits, kind, rest) == (912, 1140, 8, 2, [0, 0, 0])
    lines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(rows, 1 + 3 * columns)
    pixels = np.zeros((rows + 1, columns + 1, 3), np.uint8)
    for row, line in enumerate(lines, start=1):
        _unfilter(int(line[0]), line[1:].reshape(columns, 3), pixels, row)
    return pixels[1:, 1:]


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at, image = 8, b""
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        name, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        image += content if name == b"IDAT" else b""
        yield name, image if name == b"IDAT" else content
        at += 12 + size


def _unfilter(kind: int, line: Pixels, pixels: Pixels, row: int) -> None:
    """Of the five line filters of PNG those that need no pixel before but the one on the left or above."""
    assert kind in (0, 1, 2), f"filter {kind}"
    if kind == 1:
        pixels[row, 1:] = np.cumsum(line, axis=0, dtype=np.uint8)
    else:
        pixels[row, 1:] = line + (pixels[row - 1, 1:] if kind == 2 else 0)


def shown(blue_green_red: Pixels, number: int, depth: int) -> Pixels:
    """By the guide's table: pattern 0, 1, 2 of 8 bits is green, red, blue; 0-7, 8-15, 16-23 of 1 bit their bits."""
    byte = blue_green_red[..., (1, 2, 0)[number if depth == 8 else number // 8]]
    return byte if depth == 8 else (byte >> (number % 8) & 1) * np.uint8(255)


def rendered(pattern: Pattern) -> Pixels:
    return pattern.render(LIGHTCRAFTER_4500)


class TestFlashImages:
    @pytest.mark.parametrize("plan", ["composite", "full", "calibration"])
    def test_every_pattern_lies_where_the_manifest_says(self, run: Run, tmp_path: Path, plan: str) -> None:
        folder = tmp_path / "p"
        status, out, _ = run("patterns", "export", folder, "--plan", plan, "--json")
        assert status == 0
        manifest = FlashManifest.from_file(folder / "manifest.json")
        assert json.loads(out)["patterns"] == manifest.model_dump(mode="json")["patterns"]
        assert manifest.plan.patterns == make_plan(plan).patterns  # type: ignore[arg-type]
        names = [f"flash_{k:02d}.bmp" for k in range(manifest.images)]
        assert sorted(path.name for path in folder.iterdir()) == [*names, "manifest.json"]
        images = [bitmap(folder / name) for name in names]
        for stored in manifest.patterns:
            content = shown(images[stored.image], stored.number, stored.depth)
            assert np.array_equal(content, rendered(stored.pattern)), stored.pattern.name

    def test_three_fringes_an_image_and_the_binary_ones_as_planes(self, run: Run, tmp_path: Path) -> None:
        run("patterns", "export", tmp_path / "p")
        image = bitmap(tmp_path / "p" / "flash_00.bmp")
        for channel, name in ((1, "composite"), (2, "high_00"), (0, "high_01")):
            pattern = next(p for p in make_plan("full").patterns if p.name == name)
            assert np.array_equal(image[..., channel], rendered(pattern)), name
        binary = bitmap(tmp_path / "p" / "flash_08.bmp")
        assert set(np.unique(binary[..., 1] & 1)) == {1}, "white is the lowest plane of green"

    def test_everything_holds_each_plans_patterns_once(self, run: Run, tmp_path: Path) -> None:
        manifest = FlashManifest.packed(combined_plan(PLAN_NAMES))
        for name in PLAN_NAMES:
            assert set(make_plan(name).patterns) <= set(manifest.plan.patterns)
        assert len({s.pattern.name for s in manifest.patterns}) == len(manifest.patterns)
        status, out, _ = run(
            "patterns", "export", tmp_path / "p", "--plan", "composite", "--plan", "reference", "--json"
        )
        assert status == 0
        names = [stored["pattern"]["name"] for stored in json.loads(out)["patterns"]]
        assert sorted(names) == sorted(make_plan("full").names)

    def test_a_folder_that_is_there_is_left_alone(self, run: Run, tmp_path: Path) -> None:
        for form in ("bmp", "hdmi", "png"):
            status, _, err = run("patterns", "export", tmp_path, "--format", form, "--plan", "composite")
            assert status == 1
            assert "exists already" in err
        assert list(tmp_path.iterdir()) == []


class TestBitmaps:
    def test_rows_of_any_width_come_back(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(1)
        for columns in range(1, 9):
            image = rng.integers(0, 256, (5, columns, 3), dtype=np.uint8)
            write_image(tmp_path / "i.bmp", image)
            assert np.array_equal(read_bitmap(tmp_path / "i.bmp"), image)

    def test_one_that_stands_upright_is_read_as_well(self, tmp_path: Path) -> None:
        image = np.random.default_rng(2).integers(0, 256, (3, 4, 3), dtype=np.uint8)
        head = struct.pack("<2sIHHIIiiHHIIiiII", b"BM", 90, 0, 0, 54, 40, 4, -3, 1, 24, 0, 36, 0, 0, 0, 0)
        (tmp_path / "i.bmp").write_bytes(head + image[..., [2, 0, 1]].tobytes())
        assert np.array_equal(read_bitmap(tmp_path / "i.bmp"), image)

    @pytest.mark.parametrize(
        ("place", "value", "reason"),
        [
            (0, b"PM", "no 24-bit BMP"),
            (28, b"\x08\x00", "no 24-bit BMP"),
            (30, b"\x01", "no 24-bit BMP"),
            (18, b"\xff\xff\xff\x7f", "header is damaged"),
            (22, b"\x00\x00\x00\x80", "header is damaged"),
            (22, b"\x07", "is cut off"),
            (10, b"\x00\x00", "is cut off"),
        ],
    )
    def test_another_format_or_a_damaged_file_is_refused(
        self, tmp_path: Path, place: int, value: bytes, reason: str
    ) -> None:
        path = tmp_path / "i.bmp"
        write_image(path, np.zeros((6, 5, 3), np.uint8))
        data = bytearray(path.read_bytes())
        data[place : place + len(value)] = value
        path.write_bytes(bytes(data))
        with pytest.raises(FirmwareError, match=reason):
            read_bitmap(path)
        path.write_bytes(bytes(data[:20]))
        with pytest.raises(FirmwareError, match="no BMP"):
            read_bitmap(path)
        with pytest.raises(FirmwareError, match="cannot be read"):
            read_bitmap(tmp_path / "none.bmp")


class TestReadingBack:
    def test_a_folder_with_an_image_too_few_or_of_another_size_is_refused(self, run: Run, tmp_path: Path) -> None:
        folder = tmp_path / "p"
        run("patterns", "export", folder, "--plan", "composite")
        images, manifest = read_flash_images(folder)
        assert manifest is not None
        assert np.array_equal(images[0], manifest.render(0))
        write_image(folder / "flash_01.bmp", images[0])
        with pytest.raises(FirmwareError, match=r"holds 2 BMPs and its manifest\.json tells of 1"):
            read_flash_images(folder)
        (folder / "flash_01.bmp").unlink()
        write_image(folder / "flash_00.bmp", images[0] ^ 1)
        with pytest.raises(FirmwareError, match="does not show what"):
            read_flash_images(folder)
        (folder / "manifest.json").unlink()
        assert read_flash_images(folder)[1] is None
        write_image(folder / "flash_00.bmp", images[0][:-1])
        with pytest.raises(FirmwareError, match="912x1139 pixels"):
            read_flash_images(folder)
        (folder / "flash_00.bmp").unlink()
        with pytest.raises(FirmwareError, match="holds 0 BMPs"):
            read_flash_images(folder)
        with pytest.raises(FirmwareError, match="is not a folder"):
            read_flash_images(tmp_path / "none")


class TestFrames:
    @pytest.mark.parametrize("plan", PLAN_NAMES)
    def test_what_a_frame_shows_fits_its_time(self, plan: str) -> None:
        manifest = pack_frames(make_plan(plan))  # type: ignore[arg-type]
        for frame in manifest.frames:
            assert frame.exposure_us == frame.period_us
            assert frame.period_us * len(frame.patterns) <= VIDEO_FRAME_US
            assert frame.exposure_us >= planes.minimum_exposure_us(frame.depth)
            assert [s.number for s in frame.patterns] == list(range(len(frame.patterns)))
            assert len(frame.patterns) <= {8: 2, 1: 24}[frame.depth]
        for depth in (8, 1):
            timings = {(f.exposure_us, len(f.patterns)) for f in manifest.frames if f.depth == depth}
            assert len(timings) <= 1, "one pattern LUT does for all frames of a depth"
        names = [s.pattern.name for f in manifest.frames for s in f.patterns if s.pattern is not None]
        assert sorted(names) == sorted(make_plan(plan).names)  # type: ignore[arg-type]

    def test_two_fringes_or_two_dozen_planes_a_frame(self) -> None:
        frames = pack_frames(combined_plan(PLAN_NAMES)).frames
        assert [len(f.patterns) for f in frames if f.depth == 8] == [2] * 24
        assert [f.exposure_us for f in frames if f.depth == 8] == [8333] * 24
        assert [(len(f.patterns), f.exposure_us) for f in frames if f.depth == 1] == [(22, 757)]
        assert sum(s.pattern is None for f in frames for s in f.patterns) == 1

    def test_every_pattern_is_in_its_frame(self, run: Run, tmp_path: Path) -> None:
        folder = tmp_path / "p"
        status, _, _ = run("patterns", "export", folder, "--format", "hdmi", "--plan", "reference")
        assert status == 0
        manifest = VideoManifest.model_validate_json((folder / "manifest.json").read_bytes())
        assert manifest.channel_swap == 4
        assert {path.name for path in folder.iterdir()} == {"manifest.json", *(f.file for f in manifest.frames)}
        for frame in manifest.frames:
            blue_green_red = png(folder / frame.file)[..., ::-1]
            for place in frame.patterns:
                content = shown(blue_green_red, place.number, frame.depth)
                expected = np.zeros((1140, 912)) if place.pattern is None else rendered(place.pattern)
                assert np.array_equal(content, expected)
