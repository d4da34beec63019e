"""Many at once: the rig is moved by one at a time, and what was answered is what is kept."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import httpx2
import pytest
from small_service import SmallService, small_service

from benchmarks.service_process import ServiceProcess
from drivers.replay.source import ReplaySource
from drivers.virtual.faults import Faults, SequenceFaults
from models.capture import read_capture
from service.library.ids import is_id

REQUESTS = 200
SHARING_A_KEY = 50
CLIENTS = 20
_LIST = "/v1/captures?limit=200"


def at_once(work: Callable[[int], httpx2.Response], count: int, clients: int = CLIENTS) -> list[httpx2.Response]:
    with ThreadPoolExecutor(clients) as pool:
        return list(pool.map(work, range(count)))


def listed(client: httpx2.Client) -> set[str]:
    url, found = _LIST, set()
    while url:
        response = client.get(url).raise_for_status()
        found |= {item["id"] for item in response.json()["items"]}
        url = response.headers.get("link", "").removeprefix("<").partition(">")[0]
    return found


def test_each_request_is_answered_and_each_capture_stands_alone(live: ServiceProcess) -> None:
    patterns = ["white", "composite", "black"]
    with live.client() as client:
        client.post("/v1/captures", json={"plan": patterns}).raise_for_status()  # the first casts the scene's rays
        before = listed(client)

        def ask(number: int) -> httpx2.Response:
            time.sleep(0.02 * (number % 7))  # so that some meet a free rig
            return client.post("/v1/captures", json={"plan": patterns, "notes": str(number)})

        answers = at_once(ask, REQUESTS)
        assert Counter(a.status_code for a in answers).keys() <= {201, 409}
        taken = [answer.json() for answer in answers if answer.status_code == 201]
        refused = [answer for answer in answers if answer.status_code == 409]
        assert len(taken) >= 5
        assert len(refused) >= 5
        assert all(int(answer.headers["retry-after"]) >= 1 for answer in refused)
        made = {capture["id"] for capture in taken}
        assert len(made) == len(taken)
        assert listed(client) - before == made
        assert client.get("/v1/rig").json()["busy"] is None
    names = {path.name for path in (live.library / "captures").iterdir()}
    assert names - before == made
    assert all(is_id(name) for name in names)
    exposures = []
    for name in made:
        record = read_capture(live.library / "captures" / name).record
        for side in ("left", "right"):
            times = record.timestamps_ns[side]
            assert len(times) == 3
            exposures.append((side, times[0], times[-1]))
    for side in ("left", "right"):
        spans = sorted(span for s, *span in exposures if s == side)
        assert all(first[1] < second[0] for first, second in pairwise(spans))


def test_one_key_moves_the_rig_once_however_many_send_it(live: ServiceProcess) -> None:
    with live.client() as client:
        before = listed(client)
        key = {"Idempotency-Key": f"shared {time.monotonic_ns()}"}
        answers = at_once(lambda _: client.post("/v1/captures", json={"notes": "once"}, headers=key), SHARING_A_KEY)
        assert Counter(a.status_code for a in answers).keys() <= {201, 409}
        ids = {answer.json()["id"] for answer in answers if answer.status_code == 201}
        again = client.post("/v1/captures", json={"notes": "once"}, headers=key)
        assert again.headers["idempotency-replayed"] == "true"
        assert ids == {again.json()["id"]} == listed(client) - before


def test_as_many_reconstructions_as_wish_take_turns(small: SmallService) -> None:
    """While they wait, the service answers others at once."""
    client = small.client
    capture = client.post("/v1/captures", json={"plan": "full"}).json()["id"]
    slowest = [0.0]
    done = threading.Event()

    def look() -> None:
        while not done.wait(0.05):
            started = time.monotonic()
            assert client.get("/v1/health/ready").status_code == 200
            slowest[0] = max(slowest[0], time.monotonic() - started)

    watching = threading.Thread(target=look)
    watching.start()
    try:
        answers = at_once(lambda _: client.post("/v1/reconstructions", json={"capture": capture}), 60, 60)
    finally:
        done.set()
        watching.join()
    counts = Counter(answer.status_code for answer in answers)
    assert counts.keys() == {201, 503}
    assert counts[201] >= 16
    busy = [answer for answer in answers if answer.status_code == 503]
    assert all(answer.json()["type"] == "/v1/problems/compute-busy" for answer in busy)
    assert all(int(answer.headers["retry-after"]) >= 1 for answer in busy)
    assert 0 < slowest[0] < 2.0
    assert len({answer.json()["statistics"]["points"] for answer in answers if answer.status_code == 201}) == 1


@pytest.fixture
def counted(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[SmallService, list[int]]]:
    """A service in real time, and how many sequences were shown at each start of one."""
    shown: list[int] = []
    with small_service(ReplaySource(recorded), tmp_path / "library", realtime=True) as small:
        begin = Faults.begin_sequence

        def counting(faults: Faults) -> SequenceFaults:
            players = [t for t in threading.enumerate() if t.name == "virtual projector"]
            shown.append(len(players))
            return begin(faults)

        monkeypatch.setattr(Faults, "begin_sequence", counting)
        yield small, shown


def test_no_pulse_is_sent_for_nothing(counted: tuple[SmallService, list[int]]) -> None:
    small, others = counted
    patterns = ["white", "composite", "black"]
    answers = at_once(lambda _: small.client.post("/v1/captures", json={"plan": patterns}), 60)
    taken = [answer for answer in answers if answer.status_code == 201]
    assert len(taken) + sum(answer.status_code == 409 for answer in answers) == 60
    assert len(taken) == len(small.folders) == len(others) >= 2
    assert small.bench.pulses_sent == len(patterns) * len(taken)
    assert set(others) == {0}
