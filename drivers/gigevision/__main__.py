"""Simulated cameras as a process of their own, one trigger line to all of them.

``python -m drivers.gigevision 127.0.0.2=20497219 127.0.0.3=20497220`` prints ``ready PORT`` and runs until its standard
input ends. Datagrams to 127.0.0.1:PORT, each answered with ``ok``, or a line that says what is wrong with it:
``pulse`` once; ``train COUNT PERIOD_US`` pulses, answered when over; ``unplug ADDRESS``; ``plug ADDRESS``;
``faults ADDRESS JSON`` with TriggerFaults' names, lists for its sets.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import socket
import sys
import threading
import time
from collections.abc import Sequence

from drivers.gigevision.faults import TriggerFaults
from drivers.gigevision.server import SimulatedGrasshopper

_SPIN_S = 0.0005


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m drivers.gigevision", description="Simulated GigE Vision cameras.")
    parser.add_argument("cameras", nargs="+", metavar="ADDRESS=SERIAL", help="127.x.y.z and a serial number")
    places = [str(camera).partition("=") for camera in parser.parse_args(arguments).cameras]
    with contextlib.ExitStack() as stack:
        cameras = {address: stack.enter_context(SimulatedGrasshopper(address, serial)) for address, _, serial in places}
        commands = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        commands.bind(("127.0.0.1", 0))
        threading.Thread(target=_serve, args=(commands, cameras), daemon=True).start()
        print(f"ready {commands.getsockname()[1]}", flush=True)
        sys.stdin.read()


def send_train(cameras: Sequence[SimulatedGrasshopper], count: int, period_us: float) -> None:
    """Pulse every camera ``count`` times, in periods that do not depend on how busy the machine is."""
    start_s = time.monotonic()
    for index in range(count):
        due_s = start_s + 1e-6 * period_us * index
        while (left_s := due_s - time.monotonic()) > 0:
            time.sleep(max(0.0, left_s - _SPIN_S))
        for camera in cameras:
            camera.pulse(at_s=due_s)


def _serve(commands: socket.socket, cameras: dict[str, SimulatedGrasshopper]) -> None:
    while True:
        try:
            text, sender = commands.recvfrom(4096)
        except OSError:  # closed: the process ends
            return
        try:
            _obey(text.decode(), cameras)
            answer = "ok"
        except (ValueError, KeyError, TypeError) as error:
            answer = f"not understood: {error!r}"
        with contextlib.suppress(OSError):
            commands.sendto(answer.encode(), sender)


def _obey(text: str, cameras: dict[str, SimulatedGrasshopper]) -> None:
    word, _, rest = text.partition(" ")
    if word == "pulse":
        send_train(list(cameras.values()), 1, 0.0)
    elif word == "train":
        count, period_us = rest.split()
        send_train(list(cameras.values()), int(count), float(period_us))
    elif word in ("unplug", "plug"):
        camera = cameras[rest]
        (camera.unplug if word == "unplug" else camera.plug)()
    elif word == "faults":
        address, _, planned = rest.partition(" ")
        cameras[address].plan_faults(_faults(json.loads(planned)))
    else:
        raise ValueError(f"no command {word!r}")


def _faults(planned: dict[str, object]) -> TriggerFaults:
    """Lists become sets of indices, the keys of ``delayed`` numbers."""
    made: dict[str, object] = {}
    for name, value in planned.items():
        if isinstance(value, list):
            made[name] = frozenset(int(index) for index in value)
        elif isinstance(value, dict):
            made[name] = {int(index): float(seconds) for index, seconds in value.items()}
        else:
            made[name] = value
    return TriggerFaults(**made)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
