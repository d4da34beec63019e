"""``duofringe projector``: firmware built, looked into and written, and what is refused on the way."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from firmware_files import base_file
from flash_benches import OLD, QUICK, FlashBench

from drivers.lightcrafter import planes
from drivers.lightcrafter.bitmaps import read_bitmap
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.upload import progress_path
from models.patterns import LIGHTCRAFTER_4500
from service.cli.projector import is_virtual_machine

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def base(tmp_path: Path) -> Path:
    path = tmp_path / "base.bin"
    path.write_bytes(base_file(images=2))
    return path


def build(run: Run, base: Path, output: Path, *source: str | Path) -> dict[str, Any]:
    status, out, err = run("projector", "firmware", "build", "--base", base, "--output", output, *source, "--json")
    assert status == 0, err
    result: dict[str, Any] = json.loads(out)
    return result


@pytest.mark.parametrize("plan", ["full", "all"])
def test_every_pattern_of_a_built_file_comes_back_bit_by_bit(run: Run, base: Path, tmp_path: Path, plan: str) -> None:
    output = tmp_path / "flash.bin"
    built = build(run, base, output, "--plan", plan)
    status, out, _ = run("projector", "firmware", "inspect", output, "--images", tmp_path / "shown", "--json")
    assert status == 0
    found = json.loads(out)
    assert (found["sha256"], found["verified"], found["clear_of_bootloader"]) == (built["sha256"], True, True)
    assert len(found["images"]) == built["images"]
    assert output.read_bytes()[: found["program_bytes"]] == base.read_bytes()[: found["program_bytes"]]
    manifest = FlashManifest.from_file(output.with_name("flash.bin.json"))
    images = [read_bitmap(Path(path)) for path in found["written"]]
    assert [path.name for path in sorted((tmp_path / "shown").iterdir())] == [Path(p).name for p in found["written"]]
    for stored in manifest.patterns:
        shown = planes.shown(images[stored.image], stored.number, stored.depth)
        assert np.array_equal(shown, stored.pattern.render(LIGHTCRAFTER_4500)), stored.pattern.name
        assert stored.pattern.name in found["images"][stored.image]["patterns"]


def test_the_three_sources_make_one_file(run: Run, base: Path, tmp_path: Path) -> None:
    run("patterns", "export", tmp_path / "p", "--plan", "composite")
    sources: list[tuple[str | Path, ...]] = [
        ("--plan", "composite"),
        ("--manifest", tmp_path / "p" / "manifest.json"),
        ("--images", tmp_path / "p"),
    ]
    sums = {build(run, base, tmp_path / f"{k}.bin", *source)["sha256"] for k, source in enumerate(sources)}
    assert len(sums) == 1
    records = {(tmp_path / f"{k}.bin.json").read_text() for k in range(3)}
    assert len(records) == 1
    (tmp_path / "p" / "manifest.json").unlink()
    build(run, base, tmp_path / "3.bin", "--images", tmp_path / "p")
    status, out, _ = run("projector", "firmware", "inspect", tmp_path / "3.bin", "--json")
    assert status == 0
    assert json.loads(out)["images"][0]["patterns"] == []


def test_what_inspect_says_to_a_person(run: Run, base: Path, tmp_path: Path) -> None:
    build(run, base, tmp_path / "flash.bin", "--plan", "full")
    _, out, _ = run("projector", "firmware", "inspect", tmp_path / "flash.bin")
    assert "keeps clear of the bootloader" in out
    assert "AppCode[0]    0xF9020200  512 bytes" in out
    assert "10976 bytes, four lines  composite high_00 high_01" in out
    assert "that of its record" in out
    _, out, _ = run("projector", "firmware", "inspect", base)
    assert "no record beside it" in out


def test_nothing_is_overwritten(run: Run, base: Path, tmp_path: Path) -> None:
    output = tmp_path / "flash.bin"
    arguments = ("projector", "firmware", "build", "--base", base, "--plan", "composite", "--output", output)
    for taken in (output, tmp_path / "flash.bin.json"):
        taken.write_bytes(b"mine")
        status, _, err = run(*arguments)
        assert status == 1
        assert f"output '{taken}' exists already" in err
        assert taken.read_bytes() == b"mine"
        taken.unlink()
    status, _, err = run(*arguments[:-1], base)
    assert status == 1
    assert base.read_bytes() == base_file(images=2)


def test_a_changed_pixel_is_told_by_the_record(run: Run, base: Path, tmp_path: Path) -> None:
    output = tmp_path / "flash.bin"
    build(run, base, output, "--plan", "composite")
    data = bytearray(output.read_bytes())
    data[-100] ^= 1
    output.write_bytes(bytes(data))
    status, _, err = run("projector", "firmware", "inspect", output, "--images", tmp_path / "shown")
    assert status == 1
    assert "is not the file that" in err
    assert not (tmp_path / "shown").exists()
    output.with_name("flash.bin.json").unlink()
    assert run("projector", "firmware", "inspect", output)[0] == 0


def test_a_base_without_a_table_writes_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "base.bin").write_bytes(b"\0" * 0x30000)
    status, _, err = run(
        "projector", "firmware", "build", "--base", tmp_path / "base.bin", "--plan", "full",
        "--output", tmp_path / "flash.bin",
    )  # fmt: skip
    assert status == 1
    assert "no flash table at 0x20000" in err
    assert [path.name for path in tmp_path.iterdir()] == ["base.bin"]


class Desk:
    """A configuration, and a projector at the only USB there is."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.bench = FlashBench(folder / "flash.bin")
        self.config = folder / "rig.toml"
        self.configure("allow_flash = true")
        monkeypatch.setattr("drivers.lightcrafter.connect.UsbTransport", lambda *_, **__: self.bench.transport())
        monkeypatch.setattr("drivers.lightcrafter.upload.BootloaderTimes", lambda: QUICK)

    def configure(self, line: str) -> None:
        self.config.write_text(f"[rig.projector]\n{line}\n")

    def arguments(self, *more: str) -> tuple[str | Path, ...]:
        return ("projector", "flash", self.bench.file, "--config", self.config, *more)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    made = Desk(tmp_path, monkeypatch)
    yield made
    made.bench.assert_bootloader_untouched()


class TestFlash:
    def test_writes_the_file_and_says_so(self, run: Run, desk: Desk) -> None:
        status, out, err = run(*desk.arguments("--confirm-overwrite", "--json"))
        assert status == 0
        assert desk.bench.holds_the_file
        assert json.loads(out) == {
            "location": "USB 1-2",
            "firmware": "4.4.0",
            "images": 8,
            "sectors_written": 3,
            "sectors_kept": 0,
            "resumed": False,
        }
        assert "flash: entering the bootloader 0%" in err
        assert "flash: starting the new firmware 100%" in err

    def test_only_images_keeps_what_agrees(self, run: Run, desk: Desk) -> None:
        desk.bench.bootloader.memory[0x4F000 + 3000] ^= 0x55
        status, out, _ = run(*desk.arguments("--confirm-overwrite", "--only-images"))
        assert status == 0
        assert "8 images; 3 sectors written, 0 kept" in out
        assert desk.bench.holds_the_file

    def test_is_off_until_the_configuration_allows_it(self, run: Run, desk: Desk) -> None:
        desk.configure("")
        status, _, err = run(*desk.arguments("--confirm-overwrite"))
        assert status == 1
        assert "set allow_flash = true under [rig.projector]" in err
        assert run("projector", "flash", desk.bench.file, "--confirm-overwrite")[0] == 1
        assert desk.bench.bus.last_sequence == 0

    def test_needs_usb(self, run: Run, desk: Desk) -> None:
        desk.configure('allow_flash = true\nconnection = "usb-iss"\nport = "/dev/ttyACM7"')
        status, _, err = run(*desk.arguments("--confirm-overwrite"))
        assert status == 1
        assert "the flash is written over USB and rig.projector.connection is 'usb-iss'" in err

    def test_needs_a_yes(self, run: Run, desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
        status, _, err = run(*desk.arguments())
        assert status == 1
        assert "needs a yes" in err
        monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
        monkeypatch.setattr("typer.prompt", lambda *_, **__: "yes")
        status, _, err = run(*desk.arguments())
        assert status == 1
        assert "left as it is" in err
        assert desk.bench.bus.last_sequence == 0
        monkeypatch.setattr("typer.prompt", lambda *_, **__: "overwrite")
        assert run(*desk.arguments())[0] == 0
        assert desk.bench.holds_the_file

    def test_a_damaged_file_is_told_before_anybody_is_asked(self, run: Run, desk: Desk) -> None:
        desk.bench.file.write_bytes(OLD[:-1])
        status, _, err = run(*desk.arguments())
        assert status == 1
        assert "lies outside the file" in err

    def test_an_interrupt_leaves_it_to_be_taken_up(self, run: Run, desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
        whole = desk.bench.bootloader.handle

        def interrupting(*arguments: Any) -> tuple[bytes, bool]:
            if desk.bench.bootloader.commands == 300:
                assert threading.current_thread() is threading.main_thread()
                os.kill(os.getpid(), signal.SIGINT)
            return whole(*arguments)

        monkeypatch.setattr(desk.bench.bootloader, "handle", interrupting)
        before = signal.getsignal(signal.SIGINT)
        status, out, err = run(*desk.arguments("--confirm-overwrite"))
        assert (status, out) == (130, "")
        assert "run the same command to go on" in err
        assert signal.getsignal(signal.SIGINT) is before
        assert desk.bench.device.in_bootloader
        assert progress_path(desk.bench.file).exists()
        status, out, _ = run(*desk.arguments("--confirm-overwrite", "--json"))
        assert status == 0
        assert json.loads(out)["resumed"] is True
        assert desk.bench.holds_the_file

    def test_a_virtual_machine_is_warned_of(self, run: Run, desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
        for virtual in (True, False):
            monkeypatch.setattr("service.cli.projector.is_virtual_machine", lambda virtual=virtual: virtual)
            _, _, err = run(*desk.arguments("--confirm-overwrite"))
            assert ("warning: this computer is a virtual machine" in err) is virtual


def test_a_hypervisor_shows_in_the_processors_flags(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    assert not is_virtual_machine(cpuinfo)
    cpuinfo.write_text("model name : hypervisor 3000\nflags\t\t: fpu sse2\n")
    assert not is_virtual_machine(cpuinfo)
    cpuinfo.write_text("flags\t\t: fpu hypervisor sse2\n")
    assert is_virtual_machine(cpuinfo)


class TestRehearsal:
    def test_says_that_the_firmware_runs_again(self, run: Run, desk: Desk) -> None:
        status, out, _ = run("projector", "rehearse-flash", "--config", desk.config)
        assert status == 0
        assert "firmware 4.4.0 runs again" in out
        assert desk.bench.bootloader.log == []

    def test_is_off_until_the_configuration_allows_it(self, run: Run, desk: Desk) -> None:
        desk.configure("allow_flash = false")
        status, _, err = run("projector", "rehearse-flash", "--config", desk.config)
        assert status == 1
        assert "set allow_flash = true" in err
        assert desk.bench.bootloader.commands == 0
