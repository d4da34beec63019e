"""``duofringe bench``: another program uses it as if it had hardware."""

from __future__ import annotations

import os
import signal
import subprocess
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from bench_rig import Bench

from benchmarks.service_process import PROGRAM, ServiceProcess
from drivers.bench.bench import own_addresses
from drivers.bench.commands import BenchCommands
from service.cli import main
from service.settings import load_settings

PATIENCE_S = 20.0


def _beside(offset: int) -> list[str]:
    """Addresses of this process's own, other than those of benches in it."""
    parts = [address.split(".") for address in own_addresses().values()]
    return [".".join((first, str(int(second) + offset), *rest)) for first, second, *rest in parts]


class BenchProcess:
    """The command in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        places = _beside(128)
        self.process = subprocess.Popen(
            [PROGRAM, "bench", folder, "--left", places[0], "--right", places[1]],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={name: value for name, value in os.environ.items() if not name.startswith("DUOFRINGE_")},
        )
        self.places = places

    def say(self, line: str) -> str:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()


@pytest.fixture(scope="module")
def rehearsal(aravis: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchProcess]:
    bench = BenchProcess(tmp_path_factory.mktemp("bench") / "rehearsal")
    assert bench.say("status") == "scene 0; nothing is wrong"
    yield bench
    _, said = bench.process.communicate(timeout=PATIENCE_S)
    assert bench.process.returncode == 0
    assert str(bench.folder / "bench.toml") in said
    assert not (bench.folder / "projector").exists()


@pytest.fixture(scope="module")
def service(rehearsal: BenchProcess) -> Iterator[ServiceProcess]:
    config = rehearsal.folder / "bench.toml"
    watching = {"DUOFRINGE_ACQUISITION__WATCH_S": "0.3", "DUOFRINGE_ACQUISITION__LATE_S": "0.5"}
    with ServiceProcess(rehearsal.folder, ["--config", str(config)], watching) as service:
        yield service


def _until(reached: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while not reached():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def test_the_configuration_is_that_of_real_hardware(rehearsal: BenchProcess) -> None:
    text = (rehearsal.folder / "bench.toml").read_text()
    assert tomllib.loads(text)["rig"]["driver"] == "hardware"
    settings = load_settings(rehearsal.folder / "bench.toml")
    assert settings.rig.projector.manifest == rehearsal.folder / "manifest.json"
    assert [str(settings.rig.cameras.left.address), str(settings.rig.cameras.right.address)] == rehearsal.places


@pytest.mark.parametrize("device", ["right", "projector"])
def test_unplugged_and_plugged_in_while_serving(rehearsal: BenchProcess, service: ServiceProcess, device: str) -> None:
    """The rig says so without being asked to capture, and comes back by itself."""
    with service.client() as client:
        assert _until(lambda: client.get("/v1/rig").json()["connected"])
        assert rehearsal.say(f"unplug {device}") == f"{device} is gone"
        name = device if device == "projector" else f"{device} camera"
        assert _until(lambda: set(client.get("/v1/rig").json()["failures"]) == {name})
        told = client.get("/v1/rig").json()
        assert not told["connected"]
        assert next(d for d in told["devices"] if d["role"] == device)["state"] in ("fault", "closed")
        refused = client.post("/v1/captures", json={"plan": "composite"})
        assert refused.status_code == 503
        assert name in refused.json()["detail"]
        assert rehearsal.say(f"plug {device}") == f"{device} is there"
        assert _until(lambda: client.get("/v1/rig").json()["connected"])
        taken = client.post("/v1/captures", json={"plan": "composite"}, timeout=60)
        assert taken.status_code == 201, taken.text
        assert client.get("/v1/rig").json()["failures"] == {}


def test_a_second_bench_at_the_same_place_is_told_where_to_go(
    rehearsal: BenchProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["bench", str(tmp_path / "second"), "--left", rehearsal.places[0], "--right", rehearsal.places[1]])
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--left" in line
    assert not (tmp_path / "second").exists()


def test_a_bench_that_is_told_to_end_is_taken_down(aravis: None, tmp_path: Path) -> None:
    """By the signal that systems send at shutdown: what a program holds is let go of all the same."""
    places = _beside(64)
    folder = tmp_path / "rehearsal"
    process = subprocess.Popen(
        [PROGRAM, "bench", folder, "--left", places[0], "--right", places[1]],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert _until(lambda: (folder / "bench.toml").exists())
        assert (folder / "projector").is_symlink()
        process.terminate()
        assert process.wait(PATIENCE_S) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.communicate()
    assert not (folder / "projector").is_symlink()


class TestWhatCanBeSaid:
    @pytest.fixture
    def commands(self, bench: Bench) -> BenchCommands:
        return BenchCommands(bench.virtual)

    def test_status_tells_what_is_wrong_until_it_is_mended(self, commands: BenchCommands) -> None:
        for line in (
            "fault dropped left 5",
            "fault late both 3 always",
            "invert right",
            "cut left",
            "refuse LUT control",
            "silence start, pause and stop",
            "stuck",
            "stale",
            "unplug projector",
        ):
            commands.obey(line)
        status = commands.obey("status")
        for what in (
            "dropped at 5 of left",
            "late at 3 of both",
            "line of right inverted",
            "line of left cut",
            "LUT control refused",
            "start, pause and stop not answered",
            "validation stuck",
            "stale replies",
            "projector unplugged",
        ):
            assert what in status
        commands.obey("mend")
        assert commands.obey("status").endswith("; nothing is wrong")

    @pytest.mark.parametrize(
        ("line", "why"),
        [
            ("explode", "no command"),
            ("fault", "a fault is one of"),
            ("fault gone left", "a fault is one of"),
            ("fault dropped up 3", "'up' is neither"),
            ("invert both", "name left or right"),
            ("cut", "name left or right"),
            ("unplug lamp", "name left or right"),
            ("unplug", "name left or right"),
            ("plug left right", "name left or right"),
            ("refuse everything", "has no command 'everything'"),
            ("scene ../secret", "scenes are named"),
        ],
    )
    def test_what_cannot_be_done_says_why(self, commands: BenchCommands, line: str, why: str) -> None:
        with pytest.raises(ValueError, match=why):
            commands.obey(line)
        assert commands.obey("status").endswith("; nothing is wrong")

    def test_help_names_every_command(self, commands: BenchCommands) -> None:
        told = commands.obey("help")
        with pytest.raises(ValueError, match="known are") as caught:
            commands.obey("?")
        for word in str(caught.value).rpartition("known are ")[2].split(", "):
            assert word in told
        assert commands.obey("") == told

    def test_a_projector_without_power_cannot_be_sent_to_sleep(self, commands: BenchCommands) -> None:
        commands.obey("unplug projector")
        with pytest.raises(ValueError, match="unplugged"):
            commands.obey("standby")
        commands.obey("mend")
        commands.obey("refuse power")
        assert commands.obey("standby") == "the projector sleeps"
