"""Outputs are complete under their name or absent from it."""

from __future__ import annotations

import os
import threading

import pytest

from models.atomic import atomic_file, atomic_folder, write_text_atomically
from models.errors import DuofringeError


class InterruptionError(Exception):
    pass


def fill_and_fail(partial):
    if partial.is_dir():
        (partial / "left").mkdir()
    else:
        partial.write_text("new")
    raise InterruptionError


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_a_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "result.npz"
    with atomic_file(path) as partial:
        partial.write_bytes(b"part")
        assert not path.exists()
        assert partial.suffix == ".npz"
        assert partial.parent == tmp_path
    assert path.read_bytes() == b"part"
    assert names(tmp_path) == ["result.npz"]


def test_a_failure_keeps_the_old_file(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(InterruptionError), atomic_file(path) as partial:
        fill_and_fail(partial)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["result.txt"]


def test_two_writers_of_one_name_do_not_meet(tmp_path):
    path = tmp_path / "result.txt"
    with atomic_file(path) as first, atomic_file(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"
    assert names(tmp_path) == ["result.txt"]


def test_names_without_suffix_leave_hidden_neighbours_alone(tmp_path):
    (tmp_path / ".result").write_text("mine")
    write_text_atomically(tmp_path / "result", "ä")
    assert (tmp_path / ".result").read_text() == "mine"
    assert (tmp_path / "result").read_text(encoding="utf-8") == "ä"


def test_readers_never_see_a_part(tmp_path):
    path = tmp_path / "result.txt"
    contents = {"a" * 100_000, "b" * 100_000}
    write_text_atomically(path, "a" * 100_000)
    stop = threading.Event()
    seen: set[str] = set()

    def read() -> None:
        while not stop.is_set():
            seen.add(path.read_text())

    reader = threading.Thread(target=read)
    reader.start()
    for _ in range(20):
        for content in sorted(contents):
            write_text_atomically(path, content)
    stop.set()
    reader.join()
    assert seen <= contents


def test_a_folder_appears_only_when_it_is_complete(tmp_path):
    target = tmp_path / "capture"
    with atomic_folder(target) as partial:
        (partial / "left").mkdir()
        (partial / "left" / "white.png").write_bytes(b"x")
        assert not target.exists()
    assert (target / "left" / "white.png").read_bytes() == b"x"
    assert names(tmp_path) == ["capture"]


def test_a_failure_leaves_no_folder(tmp_path):
    with pytest.raises(InterruptionError), atomic_folder(tmp_path / "capture") as partial:
        fill_and_fail(partial)
    assert names(tmp_path) == []


def test_an_existing_folder_is_not_touched(tmp_path):
    (tmp_path / "capture").mkdir()
    with pytest.raises(DuofringeError, match="exists already"), atomic_folder(tmp_path / "capture"):
        pass
    assert names(tmp_path) == ["capture"]


@pytest.mark.parametrize("make", [atomic_file, atomic_folder])
def test_a_missing_parent_is_named_and_not_created(tmp_path, make):
    with pytest.raises(DuofringeError, match=r"nowhere' does not exist"), make(tmp_path / "nowhere" / "x"):
        pass
    assert names(tmp_path) == []


def test_a_folder_is_no_file(tmp_path):
    (tmp_path / "x").mkdir()
    with pytest.raises(DuofringeError, match="is a folder"), atomic_file(tmp_path / "x"):
        pass


def test_files_keep_the_permissions_of_the_umask(tmp_path):
    previous = os.umask(0o022)
    try:
        write_text_atomically(tmp_path / "x", "")
    finally:
        os.umask(previous)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o644
