"""A library opens once, sweeps what was left unfinished, and keeps within its disk."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
import uuid
from datetime import UTC, datetime
from pathlib import Path

import pytest
from stored_things import make_capture, make_reconstruction, open_library

from models.errors import DuofringeError
from service.library import (
    BusyError,
    DiskFullError,
    InvalidIdError,
    Library,
    LibraryBusyError,
    LibraryError,
    LibraryLimits,
    LimitError,
)
from service.library.ids import IdSource, check_id, time_of
from service.library.keyed_lock import KeyedLock

ROOT = Path(__file__).resolve().parents[2]
HOLD = """
import sys, time
from pathlib import Path
from service.library import Library, LibraryLimits
library = Library.open(Path(sys.argv[1]), LibraryLimits(minimum_free_bytes=0))
print("open", flush=True)
time.sleep(60)
"""


def test_a_library_is_open_in_one_process_until_that_ends_however(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "library")], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    try:
        assert holder.stdout.readline() == "open\n"
        with pytest.raises(LibraryBusyError, match=f"open in another service \\(process {holder.pid}\\)") as caught:
            open_library(tmp_path / "library")
        assert isinstance(caught.value, BusyError)
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.wait()
        holder.stdout.close()
    open_library(tmp_path / "library").close()


def test_a_library_is_open_once_in_this_process(tmp_path: Path) -> None:
    with open_library(tmp_path), pytest.raises(BusyError, match=f"process {os.getpid()}"):
        open_library(tmp_path)
    library = open_library(tmp_path)
    library.close()
    library.close()


def test_a_library_is_made_with_its_parents(tmp_path: Path) -> None:
    with open_library(tmp_path / "a" / "b") as library:
        assert len(library.captures) == len(library.reconstructions) == len(library.idempotency) == 0
    (tmp_path / "file").write_text("")
    with pytest.raises(LibraryError, match="cannot be opened"):
        open_library(tmp_path / "file")


def test_what_a_killed_process_left_is_swept(tmp_path: Path, rig) -> None:  # type: ignore[no-untyped-def]
    with open_library(tmp_path) as library:
        capture = library.captures.add(make_capture(), library.new_id())
        result = library.reconstructions.add(make_reconstruction(rig), capture.id, {})
    leftovers = [
        tmp_path / "captures" / f".{uuid.uuid4()}.partial-0123abcd" / "left" / "white.png",
        tmp_path / "captures" / f".deleted-{uuid.uuid4()}-0123abcd" / "capture.json",
        tmp_path / "reconstructions" / f".{uuid.uuid4()}.partial-0123abcd" / "points.npz",
        tmp_path / "reconstructions" / f".deleted-{uuid.uuid4()}" / "points.npz",
        tmp_path / "idempotency" / ".0123.partial-0123abcd.json",
        tmp_path / ".work" / "0123.ply",
        tmp_path / ".work" / ".0123.partial-1.ply",
        tmp_path / ".note.partial-0123abcd.txt",
    ]
    for path in leftovers:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"half")
    (tmp_path / "captures" / "notes").mkdir()
    with open_library(tmp_path) as library:
        assert [c.id for c in library.captures.page(10).items] == [capture.id]
        assert [r.id for r in library.reconstructions.page(10).items] == [result.id]
    assert not any(path.exists() for path in leftovers)
    kept = {p.relative_to(tmp_path).as_posix() for p in tmp_path.glob("*/*")}
    assert kept == {f"captures/{capture.id}", "captures/notes", f"reconstructions/{result.id}"}


def test_ids_are_of_version_7_and_rise_in_every_thread() -> None:
    source = IdSource()
    made: list[list[str]] = [[] for _ in range(4)]

    def make(own: list[str]) -> None:
        own += [source.new_id() for _ in range(2000)]

    threads = [threading.Thread(target=make, args=(own,)) for own in made]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(own == sorted(own) for own in made)
    everything = {i for own in made for i in own}
    assert len(everything) == 8000
    assert {uuid.UUID(i).version for i in everything} == {7}
    assert abs((time_of(source.new_id()) - datetime.now(UTC)).total_seconds()) < 5


def test_ids_rise_when_the_clock_is_set_back(monkeypatch: pytest.MonkeyPatch) -> None:
    source = IdSource()
    first = source.new_id()
    earlier = uuid.UUID(int=uuid.UUID(first).int - (10_000 << 80))
    monkeypatch.setattr("service.library.ids.uuid_utils.uuid7", lambda: earlier)
    second, third = source.new_id(), source.new_id()
    assert first < second < third
    assert uuid.UUID(third).version == 7


@pytest.mark.parametrize(
    "text",
    [
        "",
        ".",
        "..",
        "../x",
        "a" * 300,
        "0199c0de-7a11-7000-8000-00000000000g",
        "0199C0DE-7A11-7000-8000-000000000000",
        "0199c0de7a1170008000000000000000",
        "{0199c0de-7a11-7000-8000-000000000000}",
        "0199c0de-7a11-7000-8000-000000000000\n",
        "0199c0de-7a11-7000-8000-000000000000/..",
        "٠199c0de-7a11-7000-8000-000000000000",
    ],
)
def test_only_ids_become_paths(tmp_path: Path, text: str) -> None:
    with pytest.raises(InvalidIdError, match="is not an id") as caught:
        check_id(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200
    with open_library(tmp_path) as library:
        asks = [
            library.captures.get,
            library.captures.read,
            library.captures.delete,
            library.captures.archive,
            lambda t: library.captures.image_path(t, "left", "white"),
            lambda t: library.captures.add(make_capture(), t),
            library.reconstructions.get,
            library.reconstructions.load_points,
            library.reconstructions.delete,
            library.reconstructions.report,
            lambda t: library.reconstructions.artefact(t, "points.ply"),
        ]
        for ask in asks:
            with pytest.raises(InvalidIdError):
                ask(text)


def test_a_disk_that_would_fill_is_not_written_to(tmp_path: Path, rig) -> None:  # type: ignore[no-untyped-def]
    with open_library(tmp_path, LibraryLimits(minimum_free_bytes=2**60)) as library:
        for add in (
            lambda: library.captures.add(make_capture(), library.new_id()),
            lambda: library.reconstructions.add(make_reconstruction(rig), library.new_id(), {}),
        ):
            with pytest.raises(DiskFullError, match=r"must stay free.*delete captures") as caught:
                add()
            assert isinstance(caught.value, LimitError)
            assert "\n" not in str(caught.value)
    assert not any((tmp_path / "captures").iterdir())
    assert not any((tmp_path / "reconstructions").iterdir())


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("moment", ["write", "sync"])
def test_a_disk_that_fills_leaves_nothing_half(
    tmp_path: Path,
    rig,  # type: ignore[no-untyped-def]
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    moment: str,
) -> None:
    with open_library(tmp_path) as library:
        kept = library.captures.add(make_capture(), library.new_id())
        result = library.reconstructions.add(make_reconstruction(rig), kept.id, {})

        def full(*_: object, **__: object) -> None:
            raise OSError(number, os.strerror(number))

        with monkeypatch.context() as patch:
            if moment == "sync":
                patch.setattr(os, "fsync", full)
            else:
                patch.setattr(Path, "write_bytes", full)
                patch.setattr("service.library.reconstructions.write_npz", full)
                patch.setattr("models.export._WRITERS", {".ply": full})
            adding = [
                lambda: library.captures.add(make_capture(truth=True), library.new_id()),
                lambda: library.reconstructions.artefact(result.id, "points.ply"),
            ]
            if moment == "write":  # a reconstruction is not waited for until it is on the disk
                adding.append(lambda: library.reconstructions.add(make_reconstruction(rig), kept.id, {}))
            for add in adding:
                with pytest.raises(DiskFullError, match="was not kept: the library's disk is full"):
                    add()
        assert [p.name for p in (tmp_path / "captures").iterdir()] == [kept.id]
        assert [p.name for p in (tmp_path / "reconstructions").iterdir()] == [result.id]
        assert not any((tmp_path / ".work").iterdir())
        assert len(library.captures) == len(library.reconstructions) == 1
        library.captures.add(make_capture(), library.new_id())
        library.reconstructions.artefact(result.id, "points.ply")


def test_other_faults_of_the_disk_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    with open_library(tmp_path) as library, monkeypatch.context() as patch:
        patch.setattr(os, "fsync", refuse)
        with pytest.raises(LibraryError, match="was not kept: Read-only file system"):
            library.captures.add(make_capture(), library.new_id())


def test_errors_are_of_one_family() -> None:
    assert issubclass(LibraryError, DuofringeError)
    assert issubclass(DiskFullError, LibraryError)
    assert issubclass(LibraryBusyError, LibraryError)


def test_one_key_one_after_the_other_and_different_keys_together() -> None:
    locks, order = KeyedLock(), list[str]()
    entered, leave = threading.Event(), threading.Event()

    def first() -> None:
        with locks.hold("a"):
            entered.set()
            leave.wait(5)
            order.append("first")

    def second() -> None:
        with locks.hold("a"):
            order.append("second")

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    threads[0].start()
    entered.wait(5)
    threads[1].start()
    with locks.hold("b"):
        order.append("other")
    time.sleep(0.02)
    assert order == ["other"]
    leave.set()
    for thread in threads:
        thread.join()
    assert order == ["other", "first", "second"]
    assert not locks._locks


def test_close_is_what_with_does(tmp_path: Path) -> None:
    with Library.open(tmp_path) as library:
        assert library.new_id() < library.new_id()
    open_library(tmp_path).close()
