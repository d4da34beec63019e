"""One long hardware-triggered run: do two cameras at the projector's pace lose or mix up frames?

The cameras are simulated ones in a process of their own, seen through libaravis and real sockets; each picture bears
the number of the pulse that it was exposed by.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field

from benchmarks.report import parser, show
from drivers.aravis import AravisCamera
from drivers.camera import CameraSettings, StreamStatistics, Trigger
from drivers.errors import FrameTimeoutError, IncompleteFrameError
from drivers.genicam import GenicamConfiguration
from drivers.gigevision.pictures import number_on

PAIRS = 1000
EXPOSURE_US = 8333.0
GAP_US = 400.0
_PATIENCE_S = 5.0
_SERIALS = {"left": "20497219", "right": "20497220"}


class CameraProcess:
    """Two simulated cameras on one trigger line, in a child process, from ``with`` to its end."""

    def __init__(self) -> None:
        number = os.getpid()
        self.addresses = {
            side: f"127.{number >> 14 & 0x3F | 0x40}.{number >> 7 & 0x7F}.{2 * (number & 0x7F) + index}"
            for index, side in enumerate(_SERIALS)
        }

    def __enter__(self) -> CameraProcess:
        places = [f"{self.addresses[side]}={serial}" for side, serial in _SERIALS.items()]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "drivers.gigevision", *places],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        port = int(self._process.stdout.readline().removeprefix("ready "))
        self._commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._commands.connect(("127.0.0.1", port))
        return self

    def __exit__(self, *_: object) -> None:
        self._commands.close()
        self._process.communicate(timeout=_PATIENCE_S)

    def command(self, text: str, patience_s: float = _PATIENCE_S) -> None:
        """Wait until a command was carried out."""
        self._commands.settimeout(patience_s)
        self._commands.send(text.encode())
        answer = self._commands.recv(4096).decode()
        if answer != "ok":
            raise RuntimeError(answer)

    def fail(self, side: str, **faults: object) -> None:
        """Plan faults of one camera, by the names of TriggerFaults."""
        self.command(f"faults {self.addresses[side]} {json.dumps(faults)}")


@dataclass(eq=False)
class Taken:
    """What one camera gave. numbers: id of a frame -> number of the pulse on its picture."""

    numbers: dict[int, int] = field(default_factory=dict)
    damaged: list[int] = field(default_factory=list)
    statistics: StreamStatistics = field(default_factory=StreamStatistics)


def take(camera: AravisCamera, count: int) -> Taken:
    """As many frames as come, damaged ones counted."""
    taken = Taken()
    with suppress(FrameTimeoutError):
        for _ in range(count):
            try:
                frame = camera.wait_frame(_PATIENCE_S)
                taken.numbers[frame.frame_id] = number_on(frame.image)
            except IncompleteFrameError as error:
                taken.damaged.append(-1 if error.index is None else error.index)
    return taken


def armed_run(process: CameraProcess, pairs: int, exposure_us: float, gap_us: float) -> dict[str, float]:
    """Figures of one run of ``pairs`` pulses."""
    cameras = [
        AravisCamera(f"{side} camera", GenicamConfiguration.model_validate({"address": address}))
        for side, address in process.addresses.items()
    ]
    try:
        for camera in cameras:
            camera.open()
            camera.configure(CameraSettings(exposure_us=exposure_us))
        begun = time.perf_counter()
        for camera in cameras:
            camera.arm(pairs, Trigger.HARDWARE_EDGE)
        armed_s = time.perf_counter() - begun
        computing_s, begun = time.process_time(), time.perf_counter()
        with ThreadPoolExecutor(len(cameras)) as pool:
            waiting = [pool.submit(take, camera, pairs) for camera in cameras]
            period_us = exposure_us + gap_us
            process.command(f"train {pairs} {period_us}", 2e-6 * pairs * period_us + _PATIENCE_S)
            left, right = (taken.result() for taken in waiting)
        took_s = time.perf_counter() - begun
        computing_s = time.process_time() - computing_s
        for camera, taken in zip(cameras, (left, right), strict=True):
            taken.statistics = camera.disarm()
    finally:
        for camera in cameras:
            camera.close()
    both = left.numbers.keys() & right.numbers.keys()
    return {
        "pairs": pairs,
        "period_us": period_us,
        "lost_left": pairs - len(left.numbers),
        "lost_right": pairs - len(right.numbers),
        "damaged": len(left.damaged) + len(right.damaged),
        "extra": left.statistics.unclaimed + right.statistics.unclaimed,
        "mispaired": sum(not left.numbers[i] == right.numbers[i] == i % 0x1_0000 for i in both),
        "arm_ms": 1e3 * armed_s,
        "took_s": took_s,
        "cpu_percent": 100 * computing_s / took_s,
    }


def main() -> None:
    arguments = parser("armed_run", "Two simulated cameras through libaravis at the projector's pace.")
    arguments.add_argument("--pairs", type=int, default=PAIRS)
    arguments.add_argument("--exposure-us", type=float, default=EXPOSURE_US)
    arguments.add_argument("--gap-us", type=float, default=GAP_US, help="from the end of an exposure to the next pulse")
    asked = arguments.parse_args()
    with CameraProcess() as process:
        figures = armed_run(process, asked.pairs, asked.exposure_us, asked.gap_us)
    rows = [("figure", "value"), *((name, f"{value:g}") for name, value in figures.items())]
    show(f"{asked.pairs} pairs by hardware trigger", rows, figures, as_json=asked.json)


if __name__ == "__main__":
    main()
