"""The service killed at random moments of captures: what is in the library after, and does the request go on?

Each moment: a capture of the plan full is asked for under a new Idempotency-Key, the process is killed (SIGKILL) while
it works on it, another one is started on the same library, and the request is repeated.
"""

from __future__ import annotations

import contextlib
import random
import statistics
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import httpx2

from benchmarks.report import parser, show
from benchmarks.service_process import ServiceProcess
from models.capture import read_capture
from service.library.ids import is_id

MOMENTS = 20
_REQUEST = {"plan": "full", "notes": "to be interrupted"}
_SIMULATED = ("--driver", "simulated")


@dataclass(frozen=True)
class Moment:
    """What one kill left. after_s: from the request to the kill. found: none, partial or whole capture at the kill."""

    after_s: float
    found: str
    restart_s: float
    repeat_s: float


class BrokenPromiseError(AssertionError):
    """The library or the rig was not as it should be after a kill."""


def main(arguments: list[str] | None = None) -> None:
    made = parser("service_kill", __doc__.splitlines()[0])
    made.add_argument("--moments", type=int, default=MOMENTS)
    made.add_argument("--seed", type=int, default=1)
    given = made.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="duofringe-kill-") as folder:
        moments = kill_at_random(Path(folder), given.moments, random.Random(given.seed))
    counts = {found: sum(m.found == found for m in moments) for found in ("none", "partial", "whole")}
    figures = {name: [getattr(m, name) for m in moments] for name in ("after_s", "restart_s", "repeat_s")}
    rows = [["", "median", "least", "most"]]
    rows += [[name, *(f"{f(values):.2f} s" for f in (statistics.median, min, max))] for name, values in figures.items()]
    title = (
        f"{len(moments)} kills during a capture of 33 exposures, all mended. In the library at the kill: "
        f"nothing {counts['none']}, an unfinished folder {counts['partial']}, the whole capture {counts['whole']}"
    )
    data: dict[str, Any] = {"counts": counts, "moments": [asdict(moment) for moment in moments]}
    show(title, rows, data, as_json=given.json)


def kill_at_random(
    folder: Path, moments: int, draw: random.Random, arguments: Sequence[str] = _SIMULATED
) -> list[Moment]:
    """arguments: of ``duofringe serve``. Raises BrokenPromiseError at the first kill that left anything amiss."""
    service = ServiceProcess(folder, arguments)
    done: list[Moment] = []
    try:
        with service.client() as client:
            for _ in range(2):  # the first casts the rays of the scene
                started = time.monotonic()
                client.post("/v1/captures", json=_REQUEST).raise_for_status()
                longest_s = 1.1 * (time.monotonic() - started)
            expected = 2
        for number in range(moments):
            _warm(service)
            after_s = draw.uniform(0.0, longest_s)
            key = f"moment {number}"
            _kill_during_capture(service, key, after_s)
            found = _look(service.library, expected)
            started = time.monotonic()
            service = ServiceProcess(folder, arguments)
            restarted = time.monotonic()
            expected += 1
            _repeat(service, key, expected)
            done.append(Moment(after_s, found, restarted - started, time.monotonic() - restarted))
    finally:
        service.kill()
    return done


def _warm(service: ServiceProcess) -> None:
    """Cast the rays of the scene, so that the next capture takes its usual time; nothing is stored."""
    with service.client() as client:
        client.get("/v1/rig/cameras/left/preview").raise_for_status()


def _kill_during_capture(service: ServiceProcess, key: str, after_s: float) -> None:
    sent = threading.Event()

    def ask() -> None:
        with service.client() as client, contextlib.suppress(httpx2.TransportError):
            client.get("/v1/health/live")
            sent.set()
            client.post("/v1/captures", json=_REQUEST, headers={"Idempotency-Key": key})

    asking = threading.Thread(target=ask)
    asking.start()
    sent.wait()
    time.sleep(after_s)
    service.kill()
    asking.join()


def _look(library: Path, before: int) -> str:
    """What the dead process left, before anybody tidies up."""
    whole = _whole_captures(library)
    if len(whole) not in (before, before + 1):
        raise BrokenPromiseError(f"{before} captures before the kill, {len(whole)} after it")
    if len(whole) > before:
        return "whole"
    return "partial" if len(list((library / "captures").iterdir())) > len(whole) else "none"


def _repeat(service: ServiceProcess, key: str, expected: int) -> None:
    with service.client() as client:
        ready = client.get("/v1/health/ready")
        strangers = [path.name for path in (service.library / "captures").iterdir() if not is_id(path.name)]
        if ready.status_code != 200 or strangers:
            raise BrokenPromiseError(f"after the restart: {ready.text}; left over: {strangers}")
        answers = [client.post("/v1/captures", json=_REQUEST, headers={"Idempotency-Key": key}) for _ in range(2)]
        for answer in answers:
            answer.raise_for_status()
        ids = {answer.json()["id"] for answer in answers}
        listed = {item["id"] for item in client.get("/v1/captures?limit=200").json()["items"]}
    on_disk = _whole_captures(service.library)
    if len(ids) != 1 or len(on_disk) != expected or listed != on_disk or not ids <= on_disk:
        raise BrokenPromiseError(
            f"one key gave {sorted(ids)}; {len(on_disk)} captures on disk, {len(listed)} listed, {expected} expected"
        )


def _whole_captures(library: Path) -> set[str]:
    """Ids of the captures under final names, each read in full."""
    folders = [path for path in (library / "captures").iterdir() if is_id(path.name)]
    for path in folders:
        read_capture(path)
    return {path.name for path in folders}


if __name__ == "__main__":
    main()
