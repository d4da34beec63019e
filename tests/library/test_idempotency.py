"""Repeated requests: one of them is done, the others learn of it, also after the service was killed."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.library import (
    Fresh,
    IdempotencyStore,
    InProgress,
    InvalidIdError,
    LibraryError,
    LimitError,
    Mismatch,
    Replay,
)
from service.library.ids import IdSource

IDS = IdSource()


def test_one_request_is_done_once(tmp_path: Path) -> None:
    store = IdempotencyStore(tmp_path)
    first, other = IDS.new_id(), IDS.new_id()
    assert store.begin("key", "request", first) == Fresh(first)
    assert store.begin("key", "request", other) == InProgress(first)
    assert store.begin("key", "another request", other) == Mismatch()
    store.finish("key", 201, {"id": first, "points": [1.5, None, "ä"]})
    answer = Replay(201, {"id": first, "points": [1.5, None, "ä"]})
    assert store.begin("key", "request", other) == answer
    assert store.begin("key", "another request", other) == Mismatch()
    assert IdempotencyStore(tmp_path).begin("key", "request", other) == answer


def test_an_unfinished_request_is_resumed_under_its_planned_id(tmp_path: Path) -> None:
    planned, other = IDS.new_id(), IDS.new_id()
    IdempotencyStore(tmp_path).begin("key", "request", planned)  # and the process is killed
    store = IdempotencyStore(tmp_path)
    assert store.begin("key", "another", other) == Mismatch()
    assert store.begin("key", "request", other) == Fresh(planned, resumed=True)
    assert store.begin("key", "request", other) == InProgress(planned)
    store.finish("key", 200, None)
    assert store.begin("key", "request", other) == Replay(200, None)


def test_a_failed_request_may_be_repeated(tmp_path: Path) -> None:
    store = IdempotencyStore(tmp_path)
    store.begin("key", "request", IDS.new_id())
    store.abandon("key")
    assert len(store) == 0
    again = IDS.new_id()
    assert store.begin("key", "request", again) == Fresh(again)


@pytest.mark.parametrize("act", [lambda s: s.finish("key", 200, {}), lambda s: s.abandon("key")])
def test_what_was_not_begun_cannot_end(tmp_path: Path, act) -> None:  # type: ignore[no-untyped-def]
    store = IdempotencyStore(tmp_path)
    with pytest.raises(LibraryError, match="was not begun, or was answered already"):
        act(store)
    store.begin("key", "request", IDS.new_id())
    store.finish("key", 200, {})
    with pytest.raises(LibraryError, match="was not begun, or was answered already"):
        act(store)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.text(min_size=1, max_size=200), min_size=1, max_size=5, unique=True))
def test_any_text_is_a_key_of_its_own(tmp_path: Path, keys: list[str]) -> None:
    store = IdempotencyStore(tmp_path, 1000)
    for at, key in enumerate(keys):
        assert isinstance(store.begin(key, "request", IDS.new_id()), Fresh)
        store.finish(key, 200, at)
    for at, key in enumerate(keys):
        assert store.begin(key, "request", IDS.new_id()) == Replay(200, at)
        assert not any(key in p.name for p in tmp_path.iterdir() if len(key) > 4)
    for path in tmp_path.iterdir():
        path.unlink()


@pytest.mark.parametrize("key", ["../../x", "a/b", "\0", "\ud800", "x" * 200])
def test_keys_do_not_reach_the_disk(tmp_path: Path, key: str) -> None:
    (tmp_path / "store").mkdir()
    store = IdempotencyStore(tmp_path / "store")
    store.begin(key, "request", IDS.new_id())
    (path,) = (tmp_path / "store").iterdir()
    assert len(path.stem) == 64
    assert list(tmp_path.iterdir()) == [tmp_path / "store"]


@pytest.mark.parametrize("key", ["", "x" * 201])
def test_keys_have_a_length(tmp_path: Path, key: str) -> None:
    with pytest.raises(LibraryError, match="1 to 200 characters"):
        IdempotencyStore(tmp_path).begin(key, "request", IDS.new_id())
    with pytest.raises(InvalidIdError):
        IdempotencyStore(tmp_path).begin("key", "request", "../x")


def test_answers_are_forgotten_after_a_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = IdempotencyStore(tmp_path)
    for key in ("old", "young"):
        store.begin(key, "request", IDS.new_id())
        store.finish(key, 200, key)
    (old,) = [p for p in tmp_path.iterdir() if '"old"' in p.read_text()]
    yesterday = time.time() - 24 * 3600 - 1
    os.utime(old, (yesterday, yesterday))
    reopened = IdempotencyStore(tmp_path)
    assert not old.exists()
    assert isinstance(reopened.begin("young", "request", IDS.new_id()), Replay)
    assert isinstance(reopened.begin("old", "request", IDS.new_id()), Fresh)
    later = time.time() + 24 * 3600 + 10
    monkeypatch.setattr(time, "time", lambda: later)
    assert isinstance(reopened.begin("young", "request", IDS.new_id()), Fresh)
    assert isinstance(reopened.begin("old", "request", IDS.new_id()), InProgress)  # it is still under way


def test_old_answers_give_way_and_requests_under_way_do_not(tmp_path: Path) -> None:
    store = IdempotencyStore(tmp_path, limit=3)
    for key in "abcd":
        store.begin(key, "request", IDS.new_id())
        store.finish(key, 200, key)
    assert len(store) == len(list(tmp_path.iterdir())) == 3
    assert isinstance(store.begin("d", "request", IDS.new_id()), Replay)
    for key in "xyz":
        assert isinstance(store.begin(key, "request", IDS.new_id()), Fresh)
    with pytest.raises(LimitError, match="3 requests with keys are under way"):
        store.begin("w", "request", IDS.new_id())
    store.finish("y", 200, {})
    assert isinstance(store.begin("w", "request", IDS.new_id()), Fresh)
    assert isinstance(store.begin("x", "request", IDS.new_id()), InProgress)


def test_a_damaged_entry_is_as_none(tmp_path: Path) -> None:
    IdempotencyStore(tmp_path).begin("key", "request", IDS.new_id())
    (path,) = tmp_path.iterdir()
    path.write_bytes(b"{")
    new = IDS.new_id()
    assert IdempotencyStore(tmp_path).begin("key", "request", new) == Fresh(new)


def test_of_many_threads_one_does_the_work(tmp_path: Path) -> None:
    store = IdempotencyStore(tmp_path)
    outcomes: list[object] = []
    threads = [
        threading.Thread(target=lambda: outcomes.append(store.begin("key", "request", IDS.new_id()))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum(isinstance(outcome, Fresh) for outcome in outcomes) == 1
    assert sum(isinstance(outcome, InProgress) for outcome in outcomes) == 7


def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    store = IdempotencyStore(tmp_path)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LibraryError, match="could not be remembered: No space left"):
        store.begin("key", "request", IDS.new_id())
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []
    assert isinstance(store.begin("key", "request", IDS.new_id()), Fresh)
