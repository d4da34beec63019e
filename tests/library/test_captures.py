"""Captures in the library: what goes in comes out, lists hold every one once, and what is damaged is told."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from stored_things import REFERENCE_PLAN, make_capture, open_library, same_captures

from models.capture import read_capture
from models.patterns import make_plan
from models.png import read_png
from service.library import CaptureStore, DamagedError, Library, LibraryError, NotFoundError

ABSENT = "0199c0de-7a11-7000-8000-000000000000"


@pytest.fixture
def library(tmp_path: Path) -> Iterator[Library]:
    with open_library(tmp_path / "library") as opened:
        yield opened


@pytest.fixture
def store(library: Library) -> CaptureStore:
    return library.captures


class TestRoundTrip:
    @pytest.mark.parametrize("views", [1, 2])
    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    @pytest.mark.parametrize("truth", [False, True])
    def test_what_goes_in_comes_out(self, library, rig, views, dtype, truth) -> None:  # type: ignore[no-untyped-def]
        capture = make_capture(1, plan=make_plan("full"), rig=rig, views=views, dtype=dtype, truth=truth)
        stored = library.captures.add(capture, library.new_id())
        back = library.captures.read(stored.id)
        assert same_captures(capture, back)
        assert back.record.id == stored.id
        assert back.source == f"capture {stored.id}"
        assert same_captures(capture, read_capture(library.root / "captures" / stored.id))

    def test_description(self, library, store, rig) -> None:  # type: ignore[no-untyped-def]
        capture = make_capture(
            truth=True, rig=rig, settings={"exposure_us": 8333}, warnings=("dark",), object_id="vase", request="r-1"
        )
        stored = store.add(capture, library.new_id())
        assert stored == store.get(stored.id)
        assert (stored.plan, stored.patterns, stored.sides) == ("short", ("white", "composite"), ("left", "right"))
        assert (stored.size, stored.bit_depth, stored.object_id) == ((32, 24), 8, "vase")
        assert (stored.settings, stored.warnings) == ({"exposure_us": 8333}, ("dark",))
        assert stored.extra == {"request": "r-1"}
        assert stored.devices[0].driver == "test"
        assert stored.has_truth
        assert stored.has_calibration
        assert stored.damaged is None
        assert stored.created == capture.record.created
        files = [p for p in (library.root / "captures" / stored.id).rglob("*") if p.is_file()]
        assert stored.bytes_on_disk == sum(p.stat().st_size for p in files)

    def test_after_reopening(self, tmp_path: Path) -> None:
        with open_library(tmp_path) as library:
            stored = [library.captures.add(make_capture(i), library.new_id()) for i in range(3)]
        with open_library(tmp_path) as library:
            assert len(library.captures) == 3
            assert library.captures.page(10).items == tuple(reversed(stored))
            assert all(same_captures(make_capture(i), library.captures.read(s.id)) for i, s in enumerate(stored))

    def test_only_some_groups(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(truth=True), library.new_id())
        capture = store.read(stored.id, ["white"], with_truth=False)
        assert capture.plan.names == ("white",)
        assert capture.truth is None

    def test_images(self, library, store) -> None:  # type: ignore[no-untyped-def]
        capture = make_capture()
        stored = store.add(capture, library.new_id())
        path = store.image_path(stored.id, "right", "composite")
        np.testing.assert_array_equal(read_png(path), capture.images["right"]["composite"])

    @pytest.mark.parametrize(
        ("side", "pattern"),
        [
            ("left", "black"),
            ("middle", "white"),
            ("..", "white"),
            ("left", "../white"),
            ("left", "white.png"),
            ("", ""),
        ],
    )
    def test_images_that_the_record_does_not_name(self, library, store, side, pattern) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(), library.new_id())
        with pytest.raises(NotFoundError, match="has no such image"):
            store.image_path(stored.id, side, pattern)

    def test_an_id_is_used_once(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(1), library.new_id())
        with pytest.raises(LibraryError, match="exists already"):
            store.add(make_capture(2), stored.id)
        assert same_captures(store.read(stored.id), make_capture(1))


class TestDeleting:
    def test_a_deleted_capture_is_gone(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored, other = (store.add(make_capture(i), library.new_id()) for i in range(2))
        store.delete(stored.id)
        for ask in (store.get, store.read, store.delete, store.archive, lambda i: store.image_path(i, "left", "white")):
            with pytest.raises(NotFoundError, match=f"capture '{stored.id}' does not exist") as caught:
                ask(stored.id)
            assert (caught.value.kind, caught.value.id) == ("capture", stored.id)
        assert [c.id for c in store.page(10).items] == [other.id]
        assert [p.name for p in (library.root / "captures").iterdir()] == [other.id]

    def test_what_never_was(self, store) -> None:  # type: ignore[no-untyped-def]
        with pytest.raises(NotFoundError):
            store.delete(ABSENT)
        assert ABSENT not in store

    def test_a_folder_removed_by_hand_is_not_found(self, library, store) -> None:  # type: ignore[no-untyped-def]
        first, second = (store.add(make_capture(i), library.new_id()) for i in range(2))
        shutil.rmtree(library.root / "captures" / first.id)
        with pytest.raises(NotFoundError):
            store.get(first.id)
        assert [c.id for c in store.page(10).items] == [second.id]
        assert len(store) == 1

    def test_deleting_while_reading_is_not_found(self, library, store) -> None:  # type: ignore[no-untyped-def]
        failures: list[BaseException] = []
        gone = threading.Event()

        def read(id: str) -> None:  # noqa: A002
            try:
                while True:
                    assert same_captures(store.read(id), make_capture(3, plan=REFERENCE_PLAN))
                    store.get(id)
                    b"".join(store.archive(id).chunks)
            except (NotFoundError, FileNotFoundError):
                gone.set()
            except BaseException as error:  # noqa: BLE001  (told to the test)
                failures.append(error)

        for _ in range(4):
            stored = store.add(make_capture(3, plan=REFERENCE_PLAN), library.new_id())
            reader = threading.Thread(target=read, args=(stored.id,))
            reader.start()
            time.sleep(0.03)
            store.delete(stored.id)
            reader.join(10)
            assert gone.is_set()
            gone.clear()
        assert not failures

    def test_of_two_that_delete_one_does(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(), library.new_id())
        outcomes: list[str] = []

        def delete() -> None:
            try:
                store.delete(stored.id)
                outcomes.append("deleted")
            except NotFoundError:
                outcomes.append("absent")

        threads = [threading.Thread(target=delete) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(outcomes) == ["absent"] * 5 + ["deleted"]


def test_threads_that_add_delete_and_list(library, store) -> None:  # type: ignore[no-untyped-def]
    failures: list[BaseException] = []
    kept: list[str] = []
    stop = threading.Event()

    def write(seed: int) -> None:
        try:
            for n in range(8):
                stored = store.add(make_capture(seed * 10 + n), library.new_id())
                if n % 2:
                    store.delete(stored.id)
                else:
                    kept.append(stored.id)
        except BaseException as error:  # noqa: BLE001  (told to the test)
            failures.append(error)

    def look() -> None:
        try:
            while not stop.is_set():
                seen, cursor = list[str](), None
                while True:
                    page = store.page(3, cursor)
                    assert all(c.damaged is None for c in page.items)
                    seen += [c.id for c in page.items]
                    cursor = page.next_cursor
                    if cursor is None:
                        break
                assert seen == sorted(set(seen), reverse=True)
        except BaseException as error:  # noqa: BLE001
            failures.append(error)

    writers = [threading.Thread(target=write, args=(i,)) for i in range(3)]
    lookers = [threading.Thread(target=look) for _ in range(2)]
    for thread in (*writers, *lookers):
        thread.start()
    for thread in writers:
        thread.join()
    stop.set()
    for thread in lookers:
        thread.join()
    assert not failures
    assert [c.id for c in store.page(200).items] == sorted(kept, reverse=True)
    assert len(store) == len(kept) == 12


class TestDamage:
    @pytest.mark.parametrize(
        ("damage", "named"),
        [
            (lambda f: (f / "capture.json").write_text("{"), "capture.json: not readable as JSON"),
            (lambda f: (f / "capture.json").write_text('{"schema": "capture/9"}'), "capture.json: schema"),
            (lambda f: (f / "left" / "white.png").unlink(), "lacks left/white.png"),
            (lambda f: shutil.rmtree(f / "right"), "lacks right/white.png, right/composite.png"),
            (lambda f: (f / "left" / "white.png").write_bytes(b""), "left/white.png: not a whole PNG"),
            (lambda f: [shutil.rmtree(f / s) for s in ("left", "right")], "lacks left/white.png"),
            (lambda f: [p.unlink() for p in f.rglob("*") if p.is_file()], "has neither capture.json"),
        ],
    )
    def test_a_damaged_capture_is_listed_as_such(self, tmp_path: Path, damage, named: str) -> None:  # type: ignore[no-untyped-def]
        with open_library(tmp_path) as library:
            before, hurt, after = (
                library.captures.add(make_capture(i, frame_ids={"right": [1]}), library.new_id()) for i in range(3)
            )
        damage(tmp_path / "captures" / hurt.id)
        with open_library(tmp_path) as library:
            listed = library.captures.page(10).items
            assert [c.id for c in listed] == [after.id, hurt.id, before.id]
            assert [c.damaged is None for c in listed] == [True, False, True]
            reason = listed[1].damaged
            assert reason is not None
            assert named in reason
            assert str(tmp_path) not in reason
            assert "\n" not in reason
            assert abs((listed[1].created - hurt.created).total_seconds()) < 60
            assert [c.id for c in library.captures.page(10, plan="short").items] == [after.id, before.id]
            for ask in (library.captures.read, lambda i: library.captures.image_path(i, "left", "white")):
                with pytest.raises(DamagedError, match=f"capture '{hurt.id}' is damaged: ") as caught:
                    ask(hurt.id)
                assert str(tmp_path) not in str(caught.value)
            library.captures.delete(hurt.id)
            assert len(library.captures) == 2

    def test_pixels_are_found_damaged_when_they_are_read(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(), library.new_id())
        path = store.image_path(stored.id, "right", "white")
        path.write_bytes(path.read_bytes()[:-20])
        with pytest.raises(DamagedError, match=r"damaged: right/white\.png: not a whole PNG"):
            store.read(stored.id)

    def test_a_mended_capture_is_sound_again(self, library, store) -> None:  # type: ignore[no-untyped-def]
        stored = store.add(make_capture(), library.new_id())
        record = library.root / "captures" / stored.id / "capture.json"
        text = record.read_text()
        library.close()
        record.write_text("")
        with open_library(library.root) as reopened:
            assert reopened.captures.get(stored.id).damaged is not None
            record.write_text(text)
            assert reopened.captures.get(stored.id) == stored


def test_ten_thousand_captures_open_and_list_quickly(tmp_path: Path) -> None:
    with open_library(tmp_path) as library:
        ids = sorted(library.new_id() for _ in range(10_000))
        for id in ids:  # noqa: A001
            folder = tmp_path / "captures" / id
            folder.mkdir()
            (folder / "capture.json").write_text(json.dumps({"schema": "capture/1", "id": id}))
    start = time.perf_counter()
    with open_library(tmp_path) as library:
        assert len(library.captures) == 10_000
        assert [c.id for c in library.captures.page(50).items] == ids[:-51:-1]
        assert time.perf_counter() - start < 2.0
