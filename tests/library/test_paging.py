"""Pages: every item once, in order, whatever the page size and whatever comes or goes meanwhile."""

from __future__ import annotations

import base64
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.library.errors import CursorError, NotFoundError
from service.library.folder_index import FolderIndex
from service.library.ids import IdSource
from service.library.paging import decode_cursor, encode_cursor

Entry = tuple[str, str]


def load(id: str, path: Path) -> Entry:  # noqa: A002
    try:
        return id, (path / "colour").read_text()
    except FileNotFoundError as error:
        raise NotFoundError("thing", id) from error


def open_index(folder: Path) -> FolderIndex[Entry]:
    return FolderIndex(folder, "thing", load, lambda entry: None if entry[1] == "" else (entry[1],))


def put(folder: Path, id: str, colour: str) -> None:  # noqa: A002
    (folder / id).mkdir()
    (folder / id / "colour").write_text(colour)


def walk(index: FolderIndex[Entry], limit: int, newest_first: bool, colour: str | None = None) -> list[Entry]:
    found, cursor = list[Entry](), None
    while True:
        keep = None if colour is None else (lambda facts: facts[0] == colour)
        page = index.page(limit, cursor, newest_first=newest_first, keep=keep)
        assert len(page.items) <= limit
        assert len(page.items) == limit or page.next_cursor is None
        found += page.items
        cursor = page.next_cursor
        if cursor is None:
            return found


COLOURS = st.lists(st.sampled_from(["red", "blue", ""]), max_size=90)


@settings(max_examples=30)
@given(COLOURS, st.integers(1, 20), st.booleans())
def test_pages_together_are_the_list(colours: list[str], limit: int, newest_first: bool) -> None:
    with TemporaryDirectory() as name:
        folder, ids = Path(name), IdSource()
        entries = [(ids.new_id(), colour) for colour in colours]
        for entry in entries:
            put(folder, *entry)
        index = open_index(folder)
        ordered = sorted(entries, reverse=newest_first)
        assert walk(index, limit, newest_first) == ordered
        for colour in ("red", "blue", "green"):
            assert walk(index, limit, newest_first, colour) == [e for e in ordered if e[1] == colour]


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(1, 7), st.booleans(), st.data())
def test_what_comes_and_goes_between_pages(count: int, limit: int, newest_first: bool, data: st.DataObject) -> None:
    with TemporaryDirectory() as name:
        folder, ids = Path(name), IdSource()
        before = [ids.new_id() for _ in range(count)]
        for id in before:  # noqa: A001
            put(folder, id, "red")
        index = open_index(folder)
        first = index.page(limit, newest_first=newest_first)
        gone = data.draw(st.sets(st.sampled_from(before)))
        for id in gone:  # noqa: A001
            index.delete(id)
        new = ids.new_id()
        put(folder, new, "red")
        index.insert(new)
        seen, cursor = [i for i, _ in first.items], first.next_cursor
        while cursor is not None:
            page = index.page(limit, cursor, newest_first=newest_first)
            seen += [i for i, _ in page.items]
            cursor = page.next_cursor
        assert seen == sorted(set(seen), reverse=newest_first)
        assert set(before) - gone <= set(seen)
        assert (new in seen) == (not newest_first and first.next_cursor is not None)
        assert not (set(seen) - {i for i, _ in first.items}) & gone


@given(st.uuids().map(str), st.booleans())
def test_cursors_round_trip_and_keep_their_order(id: str, newest_first: bool) -> None:  # noqa: A002
    cursor = encode_cursor(id, newest_first=newest_first)
    assert decode_cursor(cursor, newest_first=newest_first) == id
    with pytest.raises(CursorError, match="belongs to the other order"):
        decode_cursor(cursor, newest_first=not newest_first)


@given(st.one_of(st.text(max_size=80), st.binary(max_size=60).map(lambda b: base64.urlsafe_b64encode(b).decode())))
def test_any_other_text_is_refused(cursor: str) -> None:
    with pytest.raises(CursorError, match="not one that this service gave") as caught:
        decode_cursor(cursor, newest_first=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("limit", [0, -1, 201, 10**9])
def test_page_sizes_have_bounds(tmp_path: Path, limit: int) -> None:
    with pytest.raises(CursorError, match="ask for 1 to 200"):
        open_index(tmp_path).page(limit)


def test_a_cursor_of_a_deleted_item_goes_on_from_there(tmp_path: Path) -> None:
    ids = [IdSource().new_id() for _ in range(4)]
    for id in ids:  # noqa: A001
        put(tmp_path, id, "red")
    index = open_index(tmp_path)
    ids.sort(reverse=True)
    page = index.page(2)
    index.delete(ids[1])
    assert [i for i, _ in index.page(2, page.next_cursor).items] == ids[2:]
