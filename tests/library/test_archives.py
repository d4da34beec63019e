"""Archives: what was sent out comes back; what was packed to do harm leaves nothing and takes little memory."""

from __future__ import annotations

import io
import json
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from memory import memory_taken_below
from stored_things import make_capture, open_library, same_captures
from test_image_files import make_png

from models.patterns import make_plan
from service.library import ArchiveError, ArchiveLimits, DiskFullError, Library, LibraryLimits, NotFoundError

Entries = dict[str, bytes]
MIB = 2**20
RECORD: dict[str, object] = {
    "schema": "capture/1",
    "id": "their-id",
    "plan": "short",
    "patterns": [{"name": "white", "kind": "white"}],
    "object_id": "vase",
}


def png(value: int = 7, dtype: type = np.uint8, shape: tuple[int, int] = (4, 5)) -> bytes:
    return bytes(cv2.imencode(".png", np.full(shape, value, dtype))[1])


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def entries(**changes: object) -> Entries:
    """A small whole capture under its id, with changes to its record."""
    record = json.dumps(RECORD | changes)
    return {"x/capture.json": record.encode(), "x/left/white.png": png(), "x/right/white.png": png(8)}


def pack(files: Entries, method: int = zipfile.ZIP_DEFLATED) -> io.BytesIO:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer


@pytest.fixture
def library(tmp_path: Path) -> Iterator[Library]:
    with open_library(tmp_path / "library") as opened:
        yield opened


def assert_nothing_left(library: Library) -> None:
    assert len(library.captures) == 0
    assert list((library.root / "captures").iterdir()) == []
    assert list((library.root / ".work").iterdir()) == []


def refused(library: Library, upload: io.BytesIO, named: str, limits: ArchiveLimits | None = None) -> str:
    with memory_taken_below(200), pytest.raises(ArchiveError, match=named) as caught:
        library.captures.import_archive(upload, limits or ArchiveLimits())
    assert "\n" not in str(caught.value)
    assert str(library.root) not in str(caught.value)
    assert len(str(caught.value)) < 400
    assert_nothing_left(library)
    return str(caught.value)


class TestRoundTrip:
    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    @pytest.mark.parametrize("views", [1, 2])
    def test_what_was_sent_comes_back(self, library, rig, dtype, views, tmp_path) -> None:  # type: ignore[no-untyped-def]
        capture = make_capture(
            2,
            plan=make_plan("full"),
            rig=rig,
            truth=True,
            dtype=dtype,
            views=views,
            object_id="vase",
            warnings=("dim",),
        )
        stored = library.captures.add(capture, library.new_id())
        sent = library.captures.archive(stored.id)
        data = b"".join(sent.chunks)
        assert (sent.name, sent.size) == (f"{stored.id}.zip", len(data))
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            assert archive.testzip() is None
            folder = library.root / "captures" / stored.id
            assert set(archive.namelist()) == {
                f"{stored.id}/{p.relative_to(folder).as_posix()}" for p in folder.rglob("*") if p.is_file()
            }
        (tmp_path / "sent.zip").write_bytes(data)
        for source in (io.BytesIO(data), tmp_path / "sent.zip"):
            back = library.captures.import_archive(source)
            assert back.id != stored.id
            assert back.extra == {"imported_id": stored.id}
            unchanged = (
                "plan",
                "patterns",
                "sides",
                "size",
                "bit_depth",
                "devices",
                "warnings",
                "object_id",
                "created",
            )
            assert all(getattr(back, name) == getattr(stored, name) for name in unchanged)
            read = library.captures.read(back.id)
            assert same_captures(read, capture)
            assert read.record.id == back.id

    def test_an_archive_is_sent_in_small_portions(self, library) -> None:  # type: ignore[no-untyped-def]
        stored = library.captures.add(make_capture(plan=make_plan("full"), shape=(480, 640)), library.new_id())
        assert max(len(chunk) for chunk in library.captures.archive(stored.id).chunks) < MIB

    def test_a_capture_deleted_while_it_is_sent(self, library) -> None:  # type: ignore[no-untyped-def]
        stored = library.captures.add(make_capture(), library.new_id())
        sent = library.captures.archive(stored.id)
        next(sent.chunks)
        library.captures.delete(stored.id)
        with pytest.raises(FileNotFoundError):
            list(sent.chunks)
        with pytest.raises(NotFoundError):
            library.captures.archive(stored.id)

    @pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
    @pytest.mark.parametrize("top", ["", "x/", "my capture (1)/"])
    def test_other_packings(self, library, method: int, top: str) -> None:  # type: ignore[no-untyped-def]
        files = {name.replace("x/", top, 1): content for name, content in entries().items()}
        stored = library.captures.import_archive(pack(files, method))
        assert stored.extra == {"imported_id": "their-id"}
        assert library.captures.read(stored.id).images["right"]["white"].max() == 8

    def test_strangers_are_left_out(self, library) -> None:  # type: ignore[no-untyped-def]
        strangers = [
            "x/left/high_00.png",
            "x/left/notes.txt",
            "x/Thumbs.db",
            "x/a/b/c.png",
            "readme.md",
            "x/left/A.png",
        ]
        strangers += ["__MACOSX/x/._capture.json", "x/truth/notes.png", "x/left/"]
        files = entries() | dict.fromkeys(strangers, b"?")
        stored = library.captures.import_archive(pack(files))
        folder = library.root / "captures" / stored.id
        kept = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
        assert kept == {"capture.json", "left/white.png", "right/white.png"}

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_without_a_record(self, library, dtype) -> None:  # type: ignore[no-untyped-def]
        stored = library.captures.import_archive(
            pack({"left/white.png": png(9, dtype), "left/black.png": png(0, dtype)})
        )
        assert (stored.patterns, stored.sides) == (("white", "black"), ("left",))
        assert stored.bit_depth == 8 * np.dtype(dtype).itemsize
        assert (library.root / "captures" / stored.id / "capture.json").is_file()
        assert library.captures.read(stored.id).images["left"]["white"].max() == 9

    def test_under_a_planned_id(self, library) -> None:  # type: ignore[no-untyped-def]
        planned = library.new_id()
        assert library.captures.import_archive(pack(entries()), id=planned).id == planned

    def test_onto_a_disk_without_room(self, tmp_path: Path) -> None:
        with open_library(tmp_path, LibraryLimits(minimum_free_bytes=2**60)) as library:
            with pytest.raises(DiskFullError):
                library.captures.import_archive(pack(entries()))
            assert_nothing_left(library)


class TestNames:
    @pytest.mark.parametrize(
        "name",
        [
            "../capture.json",
            "x/../../left/white.png",
            "/etc/passwd",
            "x//left/a.png",
            "./x/a",
            "x/left/..",
            "C:/x",
            "c:x",
            "x\\left\\white.png",
            "..\\x",
            "x/left/a\n.png",
            "x/\x1b[2J",
            "x/\u202egnp.png",
        ],
    )
    def test_names_that_could_leave_the_folder(self, library, name: str) -> None:  # type: ignore[no-untyped-def]
        refused(library, pack(entries() | {name: b"?"}), "could leave its folder")

    def test_a_name_with_a_hidden_end(self, library) -> None:  # type: ignore[no-untyped-def]
        data = pack(entries() | {"x/left/gray#00.png": b"?"}).getvalue().replace(b"gray#00", b"gray\x0000")
        refused(library, io.BytesIO(data), "could leave its folder")

    def test_no_name(self, library) -> None:  # type: ignore[no-untyped-def]
        refused(library, raw_zip({"left/white.png": (zeros(MIB), MIB), "": (b"", 0)}), "could leave its folder")

    def test_a_name_twice(self, library) -> None:  # type: ignore[no-untyped-def]
        data = pack(entries() | {"x/left/whitf.png": png(1)}).getvalue().replace(b"whitf", b"white")
        refused(library, io.BytesIO(data), "twice")

    @pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFSOCK])
    def test_what_is_no_file(self, library, kind: int) -> None:  # type: ignore[no-untyped-def]
        upload = pack(entries())
        with zipfile.ZipFile(upload, "a") as archive:
            link = zipfile.ZipInfo("x/left/black.png")
            link.external_attr = (kind | 0o777) << 16
            archive.writestr(link, "/etc/passwd")
        refused(library, upload, "a link or a device")

    def test_encrypted(self, library) -> None:  # type: ignore[no-untyped-def]
        data = bytearray(pack(entries()).getvalue())
        at = data.index(b"PK\1\2")
        data[at + 8] |= 1
        refused(library, io.BytesIO(bytes(data)), "encrypted")

    def test_two_captures(self, library) -> None:  # type: ignore[no-untyped-def]
        both = entries() | {name.replace("x/", "y/", 1): content for name, content in entries().items()}
        refused(library, pack(both), "more than one capture")

    @pytest.mark.parametrize("files", [{}, {"readme.md": b"?"}, {"a/b/capture.json": b"{}"}])
    def test_no_capture(self, library, files: Entries) -> None:  # type: ignore[no-untyped-def]
        refused(library, pack(files), "holds no capture")


def zeros(count: int) -> bytes:
    """Many zeros, deflated without a header."""
    squeeze = zlib.compressobj(9, zlib.DEFLATED, -15)
    parts = [squeeze.compress(bytes(MIB)) for _ in range(count // MIB)]
    return b"".join(parts) + squeeze.flush()


def raw_zip(files: dict[str, tuple[bytes, int]], claimed: int | None = None) -> io.BytesIO:
    """A zip of deflated contents given with their inflated sizes, whose headers claim another size."""
    body, directory = b"", b""
    for name, (content, size) in files.items():
        fields = struct.pack("<HHHHH", 20, 0, 8, 0, 0x21)
        crc = zlib.crc32(bytes(size)) if size < 2**26 else 0
        sizes = struct.pack("<III", crc, len(content), size if claimed is None else claimed)
        offset = len(body)
        body += b"PK\3\4" + fields + sizes + struct.pack("<HH", len(name), 0) + name.encode() + content
        directory += b"PK\1\2\x14\0" + fields + sizes + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, offset)
        directory += name.encode()
    end = b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, len(files), len(files), len(directory), len(body), 0)
    return io.BytesIO(body + directory + end)


class TestBombs:
    def test_one_file_that_grows(self, library) -> None:  # type: ignore[no-untyped-def]
        bomb = zeros(300 * MIB)
        upload = {"left/white.png": (bomb, 300 * MIB)}
        refused(library, raw_zip(upload), "grows more than 100 times")
        refused(library, raw_zip(upload), "left/white.png of more than 192 MiB", ArchiveLimits(ratio=1e9))
        refused(library, raw_zip({"capture.json": (bomb, 300 * MIB)}), "capture.json of more than 2 MiB")

    def test_many_files_that_grow(self, library) -> None:  # type: ignore[no-untyped-def]
        bomb = zeros(20 * MIB)
        upload = {f"left/high_{i:02d}.png": (bomb, 20 * MIB) for i in range(99)}
        refused(library, raw_zip(upload), "more than 256 MiB", ArchiveLimits(ratio=1e9, total_bytes=256 * MIB))
        refused(library, raw_zip(upload), "grows more than 100 times")

    @pytest.mark.parametrize("claimed", [100, 2**31])
    def test_headers_that_lie_about_sizes(self, library, claimed: int) -> None:  # type: ignore[no-untyped-def]
        refused(library, raw_zip({"left/white.png": (zeros(300 * MIB), 300 * MIB)}, claimed), "archive")

    @pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
    def test_packings_that_inflate_at_once(self, library, method: int) -> None:  # type: ignore[no-untyped-def]
        files = entries() | {"x/left/black.png": bytes(300 * MIB) if method == zipfile.ZIP_BZIP2 else bytes(MIB)}
        upload = pack(files, method)
        files.clear()
        refused(library, upload, "rare compression")

    def test_more_entries_than_a_capture_has(self, library) -> None:  # type: ignore[no-untyped-def]
        name = b"x/" + b"n" * 60
        central = b"PK\1\2" + bytes(24) + struct.pack("<H", len(name)) + bytes(16) + name
        count = 400_000
        end = b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central) * count, 0, 0)
        refused(library, io.BytesIO(central * count + end), "more than 4096 entries")
        refused(library, pack({f"a{i}": b"" for i in range(40)}), "more than 30 entries", ArchiveLimits(entries=30))

    def test_zip64(self, library) -> None:  # type: ignore[no-untyped-def]
        data = pack(entries()).getvalue()
        at = data.rindex(b"PK\5\6")
        locator = b"PK\6\7" + struct.pack("<IQI", 0, 0, 1)
        refused(library, io.BytesIO(data[:at] + locator + data[at:]), "zip64")

    def test_images_that_grow_when_they_are_decoded(self, library) -> None:  # type: ignore[no-untyped-def]
        image = make_png(8000, 4000)
        plan = [{"name": f"high_{i:02d}", "kind": "high", "period": 18.0, "step": i, "steps": 40} for i in range(40)]
        files = {"capture.json": json.dumps(RECORD | {"patterns": plan}).encode()}
        files |= {f"left/high_{i:02d}.png": image for i in range(40)}
        upload = pack(files)
        refused(library, upload, "more than 1024 MiB when they are decoded", ArchiveLimits(pixel_bytes=1024 * MIB))
        with memory_taken_below(200):  # within the limit, one at a time
            library.captures.import_archive(upload)

    def test_an_image_of_too_many_pixels(self, library) -> None:  # type: ignore[no-untyped-def]
        refused(library, pack(entries() | {"x/left/white.png": make_png(40_000, 1_000)}), "at most 32 megapixels")

    def test_an_array_that_claims_too_much(self, library) -> None:  # type: ignore[no-untyped-def]
        header = npy(np.zeros((4, 5), np.float32)).replace(b"(4, 5), }    ", b"(400000, 50000)}")
        refused(library, pack(entries() | {"x/truth/depth.npy": header}), r"truth/depth\.npy: truth is not readable")

    def test_a_record_nested_without_end(self, library) -> None:  # type: ignore[no-untyped-def]
        deep = entries() | {"x/capture.json": b'{"settings": ' * 100_000}
        refused(library, pack(deep), r"capture\.json: not readable as JSON")


class TestDamage:
    @pytest.mark.parametrize(
        ("change", "named"),
        [
            ({"x/left/white.png": b"?"}, r"left/white\.png: not a whole PNG"),
            ({"x/left/white.png": png()[:-20]}, r"left/white\.png: not a whole PNG"),
            ({"x/left/white.png": png(shape=(4, 5, 3))}, r"left/white\.png: has 3 channels"),  # type: ignore[arg-type]
            ({"x/left/white.png": png(dtype=np.uint16)}, "mixes 8-bit and 16-bit"),
            ({"x/capture.json": b"[]"}, r"capture\.json: content"),
            ({"x/capture.json": b"\xff\xfe"}, r"capture\.json: not readable as JSON"),
            ({"x/capture.json": b'{"schema": "capture/9"}'}, r"capture\.json: schema"),
            ({"x/capture.json": json.dumps(RECORD | {"object_id": "\ud800"}).encode()}, r"capture\.json"),
            ({"x/capture.json": json.dumps(RECORD | {"calibration": {"schema": "?"}}).encode()}, "calibration schema"),
            (
                {"x/capture.json": json.dumps(RECORD | {"bit_depth": 12}).encode()},
                "bit_depth is 12 but the images have 8",
            ),
            ({"x/capture.json": json.dumps(RECORD | {"bit_depth": 2}).encode()}, "reaches 7 but bit_depth is 2"),
            (
                {"x/capture.json": json.dumps(RECORD | {"patterns": [{"name": "../x", "kind": "white"}]}).encode()},
                "name",
            ),
            ({"x/right/white.png": None}, r"lacks right/white\.png"),
            ({"x/truth/depth.npy": npy(np.zeros((4, 5), np.float32))}, r"truth/projector_column\.npy"),
            ({"x/truth/depth.npy": npy(np.zeros((4, 6), np.float32))}, "size of the left images"),
            ({"x/truth/depth.npy": npy(np.array([{}], object))}, "Python objects"),
        ],
    )
    def test_what_is_no_whole_capture(self, library, change: dict[str, bytes | None], named: str) -> None:  # type: ignore[no-untyped-def]
        files = entries(devices=[{"role": "right", "driver": "test"}]) | change
        text = refused(library, pack({n: c for n, c in files.items() if c is not None}), named)
        assert text.startswith("the archive holds no whole capture: ")

    def test_images_of_two_sizes(self, library) -> None:  # type: ignore[no-untyped-def]
        refused(library, pack({"left/white.png": png(), "left/black.png": png(shape=(5, 4))}), "differ in size")

    @pytest.mark.parametrize("cut", [0, 1, 10, 21, 100, -1, -30])
    def test_truncated(self, library, cut: int) -> None:  # type: ignore[no-untyped-def]
        refused(library, io.BytesIO(pack(entries()).getvalue()[:cut]), "archive")

    def test_no_zip_at_all(self, library, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
        (tmp_path / "x.zip").write_bytes(bytes(100_000))
        with pytest.raises(ArchiveError, match="not a zip archive"):
            library.captures.import_archive(tmp_path / "x.zip")

    def test_a_wrong_checksum(self, library) -> None:  # type: ignore[no-untyped-def]
        data = bytearray(pack(entries(), zipfile.ZIP_STORED).getvalue())
        data[data.index(b"vase")] ^= 1
        refused(library, io.BytesIO(bytes(data)), "the archive is damaged")


WHOLE = pack(entries()).getvalue()
Change = Callable[[bytearray], None]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_any_flipped_bytes_are_refused_or_harmless(library, flips: list[tuple[int, int]]) -> None:  # type: ignore[no-untyped-def]
    data = bytearray(WHOLE)
    for at, value in flips:
        data[at] = value
    try:
        stored = library.captures.import_archive(io.BytesIO(bytes(data)))
    except ArchiveError as error:
        assert_nothing_left(library)
        told = str(error)
    else:
        told = ""
        capture = library.captures.read(stored.id)
        assert int(capture.images["left"]["white"].max()) == 7
        library.captures.delete(stored.id)
    assert "\n" not in told
    assert_nothing_left(library)
