"""The documentation of the configuration and of the first bench against the program itself."""

from __future__ import annotations

import builtins
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
import usb.core
from pydantic import BaseModel
from typer.testing import CliRunner

from drivers.genicam import GenicamConfiguration
from drivers.hardware import CamerasConfiguration
from drivers.lightcrafter import connect
from drivers.lightcrafter.emulator.bench import emulated_controller
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import UsbTransport
from drivers.registry import RigConfiguration
from models.patterns import Raster, make_plan
from service.acquisition.settings import AcquisitionSettings
from service.cli.app import app
from service.settings import LibrarySettings, ServerSettings, load_settings

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples" / "configuration").glob("*.toml"))
SECTIONS: dict[str, type[BaseModel]] = {
    "[rig]": RigConfiguration,
    "[rig.cameras]": CamerasConfiguration,
    "[rig.cameras.left]": GenicamConfiguration,
    "[rig.projector]": LightCrafterConfiguration,
    "[acquisition]": AcquisitionSettings,
    "[library]": LibrarySettings,
    "[server]": ServerSettings,
}
ELSEWHERE = {"[rig]": {"cameras", "projector"}, "[rig.cameras]": {"left", "right"}}
"""Fields that have a section of their own."""
NONE = ("–", "middle", "as it is", "the system's", "the library's")
CHECKLIST = (ROOT / "docs" / "bench-checklist.md").read_text(encoding="utf-8")


class Row(NamedTuple):
    """One key of a table. default: as it is written there."""

    key: str
    default: str


def sections(page: str) -> Iterator[tuple[str, str]]:
    """Headings of a page, and the text below each."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    parts = re.split(r"^#+ (.*)$", text, flags=re.MULTILINE)
    yield from zip(parts[1::2], parts[2::2], strict=True)


def rows(text: str) -> Iterator[Row]:
    """What the table of keys in a section tells; keys that share a row share its defaults in turn."""
    table = re.search(r"\| key \| default \| means \|\n\|[-|]+\|\n((?:\|.*\n)+)", text)
    for line in table[1].splitlines() if table else ():
        keys, default, _ = (cell.strip() for cell in line.strip("|").split("|", 2))
        named = re.findall(r"`([^`]+)`", keys)
        defaults = default.split(", ") if len(named) > 1 and ", " in default else [default] * len(named)
        yield from (Row(key, value) for key, value in zip(named, defaults, strict=True))


def described() -> dict[str, list[Row]]:
    """Rows of docs/configuration.md by the section of the file."""
    found = {}
    for heading, text in sections("configuration.md"):
        named = re.findall(r"`(\[[^`]+\])`", heading)
        if named:
            found[named[0]] = list(rows(text))
    return found


def default_of(section: type[BaseModel], key: str) -> Any:
    value: Any = section()
    for part in key.split("."):
        value = getattr(value, part)
    return value


def told(default: str) -> Any:
    """The value that a cell tells, in the terms of TOML."""
    if default in NONE:
        return None
    size = re.fullmatch(r"(\d+) MiB", default)
    if size:
        return int(size[1]) << 20
    return tomllib.loads(f"value = {default.strip('`')}")["value"]


@pytest.mark.parametrize("section", SECTIONS)
def test_every_key_is_described_and_none_that_does_not_exist(section: str) -> None:
    keys = [row.key.split(".")[0] for row in described()[section]]
    fields = set(SECTIONS[section].model_fields) - ELSEWHERE.get(section, set())
    assert set(keys) == fields


@pytest.mark.parametrize("section", SECTIONS)
def test_defaults_are_the_real_ones(section: str) -> None:
    assert_true(SECTIONS[section], described()[section])


def assert_true(section: type[BaseModel], table: list[Row]) -> None:
    assert table
    for key, default in table:
        if default:
            real = default_of(section, key)
            real = str(real) if isinstance(real, Path) else list(real) if isinstance(real, tuple) else real
            assert told(default) == real, key


def test_the_cameras_page_says_the_same() -> None:
    (table,) = (list(rows(text)) for heading, text in sections("cameras.md") if heading == "Settings")
    assert {row.key for row in table} == set(GenicamConfiguration.model_fields)
    assert_true(GenicamConfiguration, table)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_is_accepted(path: Path) -> None:
    load_settings(path)


def test_the_example_of_a_rig_is_one_of_hardware() -> None:
    path = ROOT / "examples" / "configuration" / "hardware.toml"
    settings = load_settings(path).rig
    assert settings.driver == "hardware"
    assert settings.cameras.named
    assert settings.projector.manifest == path.parent / "flash.bin.json"
    assert settings.calibration == path.parent / "calibration.json"
    given = re.findall(r"^# (\w+ = .*?)(?:  +#.*)?$", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(given) >= 5
    for line in given:
        (key,) = tomllib.loads(line)
        assert key in LightCrafterConfiguration.model_fields or key in GenicamConfiguration.model_fields


def test_settings_of_the_checklist_exist() -> None:
    """Whatever stands there as `key = value` is a line that the configuration takes."""
    known = [LightCrafterConfiguration, GenicamConfiguration, AcquisitionSettings]
    lines = re.findall(r"`(\w+ = [^`]+)`", re.sub(r"```.*?```", "", CHECKLIST, flags=re.DOTALL))
    assert len(lines) > 15
    for line in lines:
        values = tomllib.loads(line)
        (takers,) = ([kind for kind in known if key in kind.model_fields] for key in values)
        assert takers, line
        takers[0].model_validate(values)


def commands() -> list[str]:
    """Commands of the program that the checklist names, without their arguments' values."""
    text = re.sub(r"\s+", " ", CHECKLIST)
    return sorted({found.strip() for found in re.findall(r"duofringe ([a-z][^`|]*)[`|]", text)})


@pytest.mark.parametrize("line", commands())
def test_commands_of_the_checklist_exist(line: str) -> None:
    words = line.split()
    options = [word for word in words if word.startswith("--")]
    depth = 3 if words[:2] == ["projector", "firmware"] else 2 if words[0] in ("projector", "patterns") else 1
    shown = CliRunner().invoke(app, [*words[:depth], "--help"])
    assert shown.exit_code == 0, shown.output
    assert all(re.search(rf"{option}\b", shown.output) for option in options), line


def test_files_and_names_of_the_checklist_exist() -> None:
    places = re.findall(r"`(\w+)`\s+in\s+`([\w/]+\.py)`", CHECKLIST)
    assert places
    for name, path in places:
        assert re.search(rf"\b{name}\b", (ROOT / path).read_text(encoding="utf-8")), (name, path)
    for page in re.findall(r"\]\(([^)#]+)", CHECKLIST):
        assert (ROOT / "docs" / page).exists(), page


def scripts() -> dict[str, str]:
    """The scripts of the checklist by their names."""
    blocks = re.findall(r"^  ```python\n(.*?)^  ```", CHECKLIST, re.DOTALL | re.MULTILINE)
    texts = [re.sub(r"^  ", "", block, flags=re.MULTILINE) for block in blocks]
    return {text.split()[1].rstrip(":"): text for text in texts}


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> EmulatedController:
    """An emulated controller where the scripts look for a real one, and a rig.toml beside them."""
    manifest = FlashManifest.packed(make_plan("composite"))
    controller = emulated_controller(manifest, Raster(40, 24, "diamond"))
    backend = EmulatedUsb(controller)
    find = usb.core.find
    monkeypatch.setattr(usb.core, "find", lambda **wanted: find(**{**wanted, "backend": backend}))
    monkeypatch.setattr(connect, "make_transport", lambda _: UsbTransport(backend=backend))
    manifest.write(tmp_path / "manifest.json")
    text = '[rig.projector]\nmanifest = "manifest.json"\nled_limits = [128, 128, 128]\n'
    (tmp_path / "rig.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return controller


def run(name: str) -> None:
    exec(compile(scripts()[name], name, "exec"), {"__name__": "__main__"})


def test_the_raw_exchanges_give_what_is_expected(board: EmulatedController, capsys: pytest.CaptureFixture[str]) -> None:
    run("raw.py")
    replies = [line.split("-> ")[1].split() for line in capsys.readouterr().out.splitlines() if "->" in line]
    assert [reply[1] for reply in replies] == ["01", "02", "03", "04", "05"]
    assert replies[0][2:5] == ["01", "00", "01"]
    assert replies[2][2:4] == ["10", "00"]
    assert [int(reply[0], 16) & 0x20 for reply in replies] == [0, 0, 0, 0, 0x20]


def test_the_registers_are_read_and_left(board: EmulatedController, capsys: pytest.CaptureFixture[str]) -> None:
    run("reads.py")
    said = capsys.readouterr().out
    assert re.search(r"^LED current +68 87 82 ", said, re.MULTILINE)
    assert re.search(r"^display mode +00 ", said, re.MULTILINE)


def test_first_light_is_the_same_whichever_way_the_leds_are_driven_and_ends_dark(
    board: EmulatedController, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    monkeypatch.setattr(builtins, "input", lambda _: seen.append((board.light().mean(), board.led_shares())))
    run("light.py")
    ((light, drive),) = seen
    assert light == pytest.approx(255 * 128 / 255, abs=1)
    assert drive == pytest.approx([128 / 255] * 3)
    assert board.light().max() == 0


def test_load_times_are_told_for_every_image(board: EmulatedController, capsys: pytest.CaptureFixture[str]) -> None:
    run("loads.py")
    numbers = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [number[0] for number in numbers] == ["0"]
    assert float(numbers[0][1]) == pytest.approx(board.flash.load_us(0) / 1000, abs=0.01)


def test_clocks_are_compared_with_the_pulses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pairs" / "1").mkdir(parents=True)
    capture = {
        "settings": {"projector": {"pulses_us": [0.0, 8600.0, 17200.0]}},
        "timestamps_ns": {"left": [5, 8_600_005, 17_200_130], "right": [0, 8_600_000, 17_200_000]},
        "frame_ids": {"left": [0, 1, 2], "right": [0, 1, 2]},
    }
    (tmp_path / "pairs" / "1" / "capture.json").write_text(json.dumps(capture))
    run("clocks.py")
    said = capsys.readouterr().out
    assert "first ids [0, 0]" in said
    assert "125.0" in said
    assert said.split()[-1] == "125"


@pytest.mark.parametrize(("gamma", "expected"), [(1.0, 0.5), (0.45, 0.66)])
def test_a_curve_shows_in_the_mean_of_the_fringes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], gamma: float, expected: float
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "one-full" / "left"
    folder.mkdir(parents=True)
    lamp, column = np.linspace(0.3, 1, 40)[:, None], np.arange(90)
    levels = {f"high_{k:02d}": 0.5 + 0.5 * np.cos(2 * np.pi * (column - k) / 9) for k in range(9)}
    for name, level in {**levels, "white": np.ones(90), "black": np.zeros(90)}.items():
        assert cv2.imwrite(str(folder / f"{name}.png"), np.uint8(np.rint(220 * (lamp * level) ** gamma)))
    run("linear.py")
    assert float(capsys.readouterr().out) == pytest.approx(expected, abs=0.02)
