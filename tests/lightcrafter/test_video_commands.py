"""``duofringe projector video`` and ``signal``: what they show, and how they end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest
from lightcrafter_benches import serial_port, wait_until
from video_benches import assert_dark, connected, holds

from benchmarks.service_process import PROGRAM
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController

Cli = Callable[..., tuple[int, str, str]]


class Rig:
    """A configuration for a projector behind a bridge, to which any process can turn."""

    def __init__(self, device: EmulatedController, port: Path, folder: Path) -> None:
        self.device = device
        self.config = folder / "rig.toml"
        self.config.write_text(
            f'[rig.projector]\nconnection = "usb-iss"\nport = "{port}"\npacing_s = 0.002\nvalidate_first_s = 0.0\n'
        )


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    device = connected()
    with serial_port(device, "usb-iss", tmp_path) as (_, port):
        yield Rig(device, port.path, tmp_path)


@pytest.fixture
def stdin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """A standard input that stays open until it is told to end."""
    reading, writing = os.pipe()
    ends = [writing]

    def end() -> None:
        while ends:
            os.close(ends.pop())

    with closing(os.fdopen(reading, "r")) as text:
        monkeypatch.setattr(sys, "stdin", text)
        yield end
        end()


class TestCommand:
    @pytest.mark.parametrize(("words", "entries"), [((), 24), (("--patterns", "22"), 22)])
    def test_it_runs_until_its_input_ends(
        self, run: Cli, rig: Rig, stdin: Callable[[], None], words: tuple[str, ...], entries: int
    ) -> None:
        seen: list[int] = []

        def watch() -> None:
            assert wait_until(lambda: rig.device.running, 10.0)
            seen.append(len(rig.device.entries))
            stdin()

        watcher = threading.Thread(target=watch)
        watcher.start()
        status, out, err = run("projector", "video", "--depth", "1", *words, "--config", rig.config)
        watcher.join()
        assert (status, out) == (0, "")
        assert seen == [entries]
        assert "locked to 912x1140 of 1192x1170" in err
        assert "seen in frame k + 2" in err
        assert err.endswith("projector: dark\n")
        assert_dark(rig.device)

    def test_an_interrupt_leaves_it_dark(self, rig: Rig) -> None:
        words = [PROGRAM, "projector", "video", "--depth", "8", "--channel-swap", "0", "--config", rig.config]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert wait_until(lambda: rig.device.running, 20.0)
            assert process.stderr is not None
            assert "912x1140" in process.stderr.readline()
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=20)
        assert (process.returncode, err) == (0, "projector: dark\n")
        assert holds(rig.device, c.CHANNEL_SWAP) == 0
        assert_dark(rig.device)

    def test_a_lost_signal_ends_it(
        self, run: Cli, rig: Rig, stdin: Callable[[], None], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def hear(text: str) -> None:
            print(text, file=sys.stderr)
            if "locked to" in text:
                rig.device.video.disconnect()

        monkeypatch.setattr("service.cli.console.note", hear)
        status, _, err = run("projector", "video", "--depth", "8", "--config", rig.config)
        assert status == 1
        assert "shows the video frames no longer" in err
        assert_dark(rig.device)

    def test_no_signal_ends_it(self, run: Cli, rig: Rig, stdin: Callable[[], None]) -> None:
        rig.device.video.disconnect()
        status, _, err = run("projector", "video", "--depth", "8", "--config", rig.config)
        assert status == 1
        assert "set the output of the graphics card to exactly 912x1140 at 60 Hz" in err
        assert "dark" not in err
        assert_dark(rig.device)

    def test_too_many_patterns_light_nothing(self, run: Cli, rig: Rig, stdin: Callable[[], None]) -> None:
        status, _, err = run("projector", "video", "--depth", "8", "--patterns", "3", "--config", rig.config)
        assert status == 1
        assert "3 patterns of 8 bits do not go into a video frame" in err
        assert_dark(rig.device)

    def test_other_depths_are_wrong_usage(self, run: Cli, rig: Rig) -> None:
        status, _, err = run("projector", "video", "--depth", "4", "--config", rig.config)
        assert status == 2
        assert "Error: " in err

    def test_the_signal_is_told(self, run: Cli, rig: Rig) -> None:
        status, out, _ = run("projector", "signal", "--config", rig.config)
        assert (status, out.startswith("locked to 912x1140 of 1192x1170 in all")) == (0, True)
        assert_dark(rig.device)
        rig.device.video.connect(1280, 800)
        found = json.loads(run("projector", "signal", "--json", "--config", rig.config)[1])
        assert (found["locked"], found["columns"], found["rows"]) == (True, 1280, 800)
        rig.device.video.disconnect()
        assert run("projector", "signal", "--config", rig.config)[1] == "not locked to any video signal\n"

    @pytest.mark.parametrize("command", ["video", "signal"])
    def test_help_names_it(self, run: Cli, command: str) -> None:
        status, out, _ = run("projector", command, "--help")
        assert status == 0
        assert f"Example: duofringe projector {command} " in " ".join(out.split())
