"""Simulated cameras as a process of their own: its commands."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from drivers.aravis import AravisCamera
from drivers.camera import CameraSettings, Trigger
from drivers.errors import DeviceLostError, DeviceNotFoundError
from drivers.genicam import GenicamConfiguration
from drivers.gigevision.pictures import number_on

Ask = Callable[[str], str]


@pytest.fixture
def ask(address: Callable[[int], str]) -> Iterator[Ask]:
    """Sends a command to a process with one camera and returns its answer."""
    with (
        subprocess.Popen(
            [sys.executable, "-m", "drivers.gigevision", f"{address(0)}=77"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as commands,
    ):
        assert process.stdout is not None
        commands.connect(("127.0.0.1", int(process.stdout.readline().split()[1])))
        commands.settimeout(10.0)

        def ask(text: str) -> str:
            commands.send(text.encode())
            return commands.recv(4096).decode()

        yield ask
        process.communicate(timeout=10)
        assert process.returncode == 0


def test_pulses_faults_and_death_by_command(aravis: None, ask: Ask, address: Callable[[int], str]) -> None:
    camera = AravisCamera("left camera", GenicamConfiguration.model_validate({"address": address(0)}))
    assert camera.open().serial == "77"
    camera.configure(CameraSettings(exposure_us=4000))
    assert ask(f'faults {address(0)} {{"dropped": [2], "delayed": {{"3": 0.05}}}}') == "ok"
    camera.arm(6, Trigger.HARDWARE_EDGE)
    assert ask("pulse") == "ok"
    assert camera.wait_frame(3.0).frame_id == 0
    assert ask("train 4 8333") == "ok"
    frames = [camera.wait_frame(3.0) for _ in range(3)]
    assert [(frame.frame_id, number_on(frame.image)) for frame in frames] == [(1, 1), (3, 3), (4, 4)]
    assert ask(f"unplug {address(0)}") == "ok"
    with pytest.raises(DeviceLostError):
        camera.wait_frame(5.0)
    camera.close()
    with pytest.raises(DeviceNotFoundError):
        camera.open()
    assert ask(f"plug {address(0)}") == "ok"
    camera.open()
    camera.close()


@pytest.mark.parametrize(
    "text", ["", "jump", "train", "train x y", "plug 127.9.9.9", "faults", 'faults 127.9.9.9 {"dropped": [1]}']
)
def test_what_it_does_not_understand_it_says(ask: Ask, text: str) -> None:
    assert ask(text).startswith("not understood: ")
    assert ask("pulse") == "ok"
