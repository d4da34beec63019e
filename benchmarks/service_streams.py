"""Live view, capture, live view, again and again: does the service end up with what it began with?"""

from __future__ import annotations

import re
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import httpx2

from benchmarks.report import parser, show
from benchmarks.service_process import ServiceProcess

ROUNDS = 50
_PLAN = "full"
_PATIENCE_S = 10.0
_PART = re.compile(rb"--duofringe-frame\r\n")
_SETTLED_S = 12.0
"""Threads that answered requests end when they had nothing to do for ten seconds."""


@dataclass(frozen=True)
class Held:
    """What a service process holds while nobody asks anything of it. descriptors: what they lead to."""

    threads: int
    descriptors: tuple[str, ...]

    @classmethod
    def by(cls, service: ServiceProcess) -> Held:
        return cls(service.threads, tuple(re.sub(r"\d+", "N", name) for name in service.descriptors))


@dataclass(eq=False)
class Viewer:
    """Watches a camera's stream in a thread of its own. frames: when each arrived (monotonic s)."""

    service: ServiceProcess
    frames: list[float] = field(default_factory=list)
    ended: bool = False

    def __enter__(self) -> Viewer:
        self._leave = threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        wait_for(lambda: len(self.frames) >= 2, "the first frames of a stream")
        return self

    def __exit__(self, *_: object) -> None:
        self._leave.set()
        self._thread.join(_PATIENCE_S)

    def _watch(self) -> None:
        try:
            with self.service.client() as client, client.stream("GET", "/v1/rig/cameras/left/stream") as response:
                for chunk in response.iter_raw():
                    self.frames += [time.monotonic()] * len(_PART.findall(chunk))
                    if self._leave.is_set():
                        return
        except httpx2.TransportError:
            return
        finally:
            self.ended = True

    @property
    def longest_pause_s(self) -> float:
        return max(b - a for a, b in zip(self.frames, self.frames[1:], strict=False))


def main(arguments: list[str] | None = None) -> None:
    made = parser("service_streams", __doc__.splitlines()[0])
    made.add_argument("--rounds", type=int, default=ROUNDS)
    given = made.parse_args(arguments)
    with (
        tempfile.TemporaryDirectory(prefix="duofringe-streams-") as folder,
        ServiceProcess(Path(folder), ["--driver", "simulated"]) as service,
    ):
        before, after, pauses = run_rounds(service, given.rounds)
    rows = [
        ["", "before", "after"],
        ["threads", str(before.threads), str(after.threads)],
        ["open file descriptors", str(len(before.descriptors)), str(len(after.descriptors))],
    ]
    shortest_s, longest_s = min(pauses), max(pauses)
    title = (
        f"{given.rounds} rounds of stream, capture, stream; the stream paused {1e3 * shortest_s:.0f} to "
        f"{1e3 * longest_s:.0f} ms for a capture of 33 exposures"
    )
    data = {"rounds": given.rounds, "threads": [before.threads, after.threads], "pauses_s": pauses}
    data["descriptors"] = [len(before.descriptors), len(after.descriptors)]
    show(title, rows, data, as_json=given.json)
    if before != after:
        raise SystemExit(f"not given back: {before} became {after}")


def run_rounds(service: ServiceProcess, rounds: int) -> tuple[Held, Held, list[float]]:
    """What the service holds after one round and after all of them, and the pause of the stream in each, s."""
    one_round(service)
    before = settled(service)
    pauses = [one_round(service) for _ in range(rounds)]
    return before, settled(service, before), pauses


def one_round(service: ServiceProcess) -> float:
    """Watch, capture, watch on, leave; returns how long the stream paused, s."""
    with service.client() as client, Viewer(service) as viewer:
        answer = client.post("/v1/captures", json={"plan": _PLAN})
        answer.raise_for_status()
        count = len(viewer.frames)
        wait_for(lambda: len(viewer.frames) >= count + 2, "frames after the capture")
    with service.client() as client:
        wait_for(lambda: _is_at_rest(client), "the cameras to rest after the viewer left")
    exposed_s = answer.json()["timings_s"]["expose"]
    if viewer.longest_pause_s < exposed_s:
        raise AssertionError(f"a frame came within the {exposed_s:.3f} s of the exposures")
    return viewer.longest_pause_s


def settled(service: ServiceProcess, like: Held | None = None) -> Held:
    """What the service holds once that stays for a second; waits longer for it to become ``like``."""
    until = time.monotonic() + _SETTLED_S
    held, since = Held.by(service), time.monotonic()
    while time.monotonic() < until and held != like and (like is not None or time.monotonic() - since < 1.0):
        with service.client() as client:
            client.get("/v1/rig")  # idle threads are looked for when a thread is needed
        time.sleep(0.3)
        now = Held.by(service)
        if now != held:
            held, since = now, time.monotonic()
    return held


def wait_for(condition: Callable[[], bool], what: str) -> None:
    """Raises AssertionError when it does not come true in time."""
    until = time.monotonic() + _PATIENCE_S
    while not condition():
        if time.monotonic() > until:
            raise AssertionError(f"waited {_PATIENCE_S:g} s in vain for {what}")
        time.sleep(0.01)


def _is_at_rest(client: httpx2.Client) -> bool:
    states = [device["state"] for device in client.get("/v1/rig").json()["devices"]]
    return "armed" not in states and "holding" not in states


if __name__ == "__main__":
    main()
