"""Reconstructions in the library: the same points come out, in every format, once, however many ask."""

from __future__ import annotations

import base64
import html.parser
import json
import re
import threading
import time
import zipfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from simulated_captures import objects_before_wall, only
from stored_things import make_capture, make_points, make_reconstruction, open_library

from models.export import SUFFIXES, write_points
from models.export.npz import ARRAYS, read_npz, write_npz
from models.geometry.rig import Rig
from models.points import PointMap, Reason
from models.reconstruct import Reconstruction, ReconstructionOptions, reconstruct
from models.refiner.configuration import RefinerConfiguration
from models.refiner.weights import WeightsRecord
from service.library import DamagedError, Library, LibraryError, NotFoundError, StoredReconstruction
from service.library import reconstructions as module
from service.library.artefacts import ARTEFACTS
from service.library.phases import read_phase
from service.library.reconstruction_record import ReconstructionRecord
from service.overview import write_maps
from service.pictures import INVALID_GREY

ABSENT = "0199c0de-7a11-7000-8000-000000000000"


@pytest.fixture
def library(tmp_path: Path) -> Iterator[Library]:
    with open_library(tmp_path / "library") as opened:
        yield opened


@pytest.fixture
def result(rig: Rig) -> Reconstruction:
    return make_reconstruction(rig)


@pytest.fixture
def stored(library: Library, result: Reconstruction) -> StoredReconstruction:
    return library.reconstructions.add(result, library.new_id(), {"warnings": ["saturated"], "job": 7})


@pytest.fixture(scope="module")
def simulated() -> Reconstruction:
    return reconstruct(only(objects_before_wall(), ["composite"]), ReconstructionOptions())


def same_points(a: PointMap, b: PointMap) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(PointMap)]
    return all(x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in pairs)


class TestRoundTrip:
    def test_points_to_the_bit(self, library, result, stored) -> None:  # type: ignore[no-untyped-def]
        assert same_points(library.reconstructions.load_points(stored.id), result.points)

    def test_record(self, library, result, stored) -> None:  # type: ignore[no-untyped-def]
        record = stored.record
        written = json.loads((library.root / "reconstructions" / stored.id / "reconstruction.json").read_text())
        assert written["schema"] == "reconstruction/1"
        assert ReconstructionRecord.model_validate(written) == record
        assert (record.id, record.method, record.matching) == (stored.id, "wft", "stereo")
        assert (record.depth_range, record.size) == ((400.0, 700.0), (32, 24))
        assert record.phases == {"left": ("high", "low"), "right": ("high", "low")}
        assert written["weights"] is None
        assert record.extra == {"warnings": ["saturated"], "job": 7}
        assert record.timings_s == {"phase": 0.1, "matching": 0.2, "points": 0.05}
        assert re.fullmatch(r"[0-9a-f]{64}", record.calibration)
        assert record.software.startswith("duofringe")
        statistics = record.statistics
        points = result.points
        assert statistics.points == len(points)
        assert statistics.valid_percent == pytest.approx(100 * points.valid.mean(), abs=0.01)
        assert statistics.reasons_percent["no_match"] == pytest.approx(100 - statistics.valid_percent, abs=0.02)
        assert statistics.z_mm[1] == pytest.approx(np.nanmedian(points.depth), abs=1e-3)
        assert statistics.median_confidence == pytest.approx(np.median(points.confidence[points.valid]), abs=1e-4)
        assert statistics.origins_percent == {"left_right": 100.0, "left_projector": 0.0}

    def test_weights_of_the_refiner(self, library, result) -> None:  # type: ignore[no-untyped-def]
        weights = WeightsRecord(
            configuration=RefinerConfiguration(), periods=(9, 14), variant="sim+adapt", sha256="0123456789abcdef" * 4
        )
        options = ReconstructionOptions("refiner", weights="my-rig")
        stored = library.reconstructions.add(replace(result, options=options, weights=weights), ABSENT, {})
        used = stored.record.weights
        assert (used.name, used.variant, used.sha256) == ("my-rig", "sim+adapt", weights.sha256)
        shown = library.reconstructions.report(stored.id, {})
        assert "my-rig, variant sim+adapt" in shown
        assert weights.sha256 in shown

    def test_a_record_from_before_there_were_weights(self, library, stored) -> None:  # type: ignore[no-untyped-def]
        path = library.reconstructions.artefact(stored.id, "points.npz").with_name("reconstruction.json")
        written = json.loads(path.read_text())
        del written["weights"]
        assert ReconstructionRecord.model_validate(written).weights is None

    def test_after_reopening(self, library, result, stored) -> None:  # type: ignore[no-untyped-def]
        library.close()
        with open_library(library.root) as reopened:
            assert reopened.reconstructions.get(stored.id) == stored
            assert same_points(reopened.reconstructions.load_points(stored.id), result.points)

    def test_of_one_capture(self, library, result) -> None:  # type: ignore[no-untyped-def]
        captures = [library.new_id() for _ in range(2)]
        ids = [library.reconstructions.add(result, captures[n % 2], {}).id for n in range(6)]
        page = library.reconstructions.page(2, capture=captures[1])
        rest = library.reconstructions.page(2, page.next_cursor, capture=captures[1])
        assert [r.id for r in (*page.items, *rest.items)] == ids[5::-2]
        assert rest.next_cursor is None
        assert library.reconstructions.page(5, capture=ABSENT).items == ()

    def test_planned_ids_are_used_once(self, library, result) -> None:  # type: ignore[no-untyped-def]
        planned = library.new_id()
        assert library.reconstructions.add(result, ABSENT, {}, id=planned).id == planned
        with pytest.raises(LibraryError, match="exists already"):
            library.reconstructions.add(result, ABSENT, {}, id=planned)

    def test_deleting(self, library, stored) -> None:  # type: ignore[no-untyped-def]
        library.reconstructions.artefact(stored.id, "points.ply")
        library.reconstructions.delete(stored.id)
        asks = (
            library.reconstructions.get,
            library.reconstructions.load_points,
            library.reconstructions.delete,
            library.reconstructions.report,
            lambda i: library.reconstructions.artefact(i, "points.ply"),
        )
        for ask in asks:
            with pytest.raises(NotFoundError, match=f"reconstruction '{stored.id}' does not exist"):
                ask(stored.id)
        assert list((library.root / "reconstructions").iterdir()) == []

    def test_results_outlive_their_capture(self, library, result) -> None:  # type: ignore[no-untyped-def]
        capture = library.captures.add(make_capture(), library.new_id())
        kept = library.reconstructions.add(result, capture.id, {})
        library.captures.delete(capture.id)
        assert library.reconstructions.page(5, capture=capture.id).items == (kept,)


class TestArtefacts:
    @pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s != ".tif"])
    def test_clouds_are_those_of_the_command_line(self, library, simulated, tmp_path: Path, suffix: str) -> None:  # type: ignore[no-untyped-def]
        stored = library.reconstructions.add(simulated, ABSENT, {})
        name = "depth.tiff" if suffix == ".tiff" else f"points{suffix}"
        path = library.reconstructions.artefact(stored.id, name)
        write_points(simulated.points, tmp_path / f"direct{suffix}")
        if suffix == ".npz":
            with np.load(path) as ours, np.load(tmp_path / "direct.npz") as direct:
                assert set(ours) == set(direct) == set(ARRAYS)
                for array in ARRAYS:
                    assert ours[array].tobytes() == direct[array].tobytes()
                    assert ours[array].dtype == direct[array].dtype
        else:
            assert path.read_bytes() == (tmp_path / f"direct{suffix}").read_bytes()

    def test_pictures_are_those_of_the_demonstration(self, library, simulated, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
        stored = library.reconstructions.add(simulated, ABSENT, {})
        write_maps(simulated, tmp_path, "direct")
        assert stored.artefacts == ARTEFACTS
        for name in (n for n in ARTEFACTS if n.endswith(".png")):
            ours = cv2.imread(str(library.reconstructions.artefact(stored.id, name)))
            direct = cv2.imread(str(tmp_path / f"direct_{name.replace('/', '_')}"))
            differs = np.abs(ours.astype(int) - direct.astype(int)).max(axis=2)
            assert np.array_equal((ours == INVALID_GREY).all(axis=2), (direct == INVALID_GREY).all(axis=2))
            assert differs.max() <= 8  # phases are kept to 1e-4 rad: one step of the colours
            assert (differs > 0).mean() < (0.01 if name.startswith("phase") else 1e-9)

    def test_phases_are_kept_closely(self, library, simulated) -> None:  # type: ignore[no-untyped-def]
        stored = library.reconstructions.add(simulated, ABSENT, {})
        path = library.root / "reconstructions" / stored.id / "phases.npz"
        for side, phase in simulated.phases.items():
            for at, carrier in enumerate(("high", "low")):
                kept = read_phase(path, carrier, side)
                usable = phase.mask.numpy() == Reason.VALID
                assert np.array_equal(np.isfinite(kept), usable)
                assert np.abs(kept - phase.wrapped[at].numpy())[usable].max() < 1e-4

    @pytest.mark.parametrize("name", ["", "points.stl", "../reconstruction.json", "reconstruction.json", "/etc/passwd"])
    def test_other_names(self, library, stored, name: str) -> None:  # type: ignore[no-untyped-def]
        with pytest.raises(NotFoundError, match="has no such file; ask for one of points"):
            library.reconstructions.artefact(stored.id, name)

    def test_a_phase_that_the_method_does_not_make(self, library, rig) -> None:  # type: ignore[no-untyped-def]
        stored = library.reconstructions.add(make_reconstruction(rig, carriers=1), ABSENT, {})
        assert library.reconstructions.artefact(stored.id, "phase/high/right.png").is_file()
        assert not any("low" in name for name in stored.artefacts)
        with pytest.raises(NotFoundError, match="has no phase of the low carrier in the left view"):
            library.reconstructions.artefact(stored.id, "phase/low/left.png")

    def test_many_that_ask_make_it_once(self, library, stored, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
        made: list[str] = []
        make = module.make_artefact

        def slowly(artefact, folder, output):  # type: ignore[no-untyped-def]
            made.append(artefact)
            time.sleep(0.05)
            make(artefact, folder, output)

        monkeypatch.setattr(module, "make_artefact", slowly)
        paths: list[Path] = []
        threads = [
            threading.Thread(target=lambda: paths.append(library.reconstructions.artefact(stored.id, "points.ply")))
            for _ in range(6)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert made == ["points.ply"]
        assert len(paths) == 6
        assert len(set(paths)) == 1
        assert library.reconstructions.artefact(stored.id, "points.ply") == paths[0]
        assert len(made) == 1

    def test_deleted_while_it_is_made(self, library, stored, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
        make = module.make_artefact

        def deleted_before(artefact, folder, output):  # type: ignore[no-untyped-def]
            library.reconstructions.delete(stored.id)
            make(artefact, folder, output)

        def deleted_after(artefact, folder, output):  # type: ignore[no-untyped-def]
            make(artefact, folder, output)
            library.reconstructions.delete(other.id)

        monkeypatch.setattr(module, "make_artefact", deleted_before)
        with pytest.raises(NotFoundError):
            library.reconstructions.artefact(stored.id, "points.ply")
        monkeypatch.undo()
        other = library.reconstructions.add(make_reconstruction(objects_before_wall().rig), ABSENT, {})
        monkeypatch.setattr(module, "make_artefact", deleted_after)
        with pytest.raises(NotFoundError):
            library.reconstructions.artefact(other.id, "points.glb")
        assert list((library.root / ".work").iterdir()) == []


class TestDamage:
    @pytest.mark.parametrize("name", ["reconstruction.json", "points.npz", "phases.npz"])
    def test_what_lacks_a_file_is_listed_as_damaged(self, library, stored, result, name: str) -> None:  # type: ignore[no-untyped-def]
        library.close()
        (library.root / "reconstructions" / stored.id / name).unlink()
        with open_library(library.root) as reopened:
            store = reopened.reconstructions
            sound = store.add(result, ABSENT, {})
            listed = store.page(5).items
            assert [r.id for r in listed] == [sound.id, stored.id]
            assert listed[0].damaged is None
            assert listed[1].damaged == f"{name}: No such file or directory"
            assert listed[1].record is None
            assert listed[1].artefacts == ()
            for ask in (store.report, lambda i: store.artefact(i, "points.ply")):
                with pytest.raises(DamagedError, match=f"is damaged: {re.escape(name)}: No such file"):
                    ask(stored.id)
            store.delete(stored.id)

    @pytest.mark.parametrize("content", ["{", "[]", '{"schema": "reconstruction/9"}', "[" * 100_000])
    def test_a_record_that_is_none(self, library, stored, content: str) -> None:  # type: ignore[no-untyped-def]
        library.close()
        (library.root / "reconstructions" / stored.id / "reconstruction.json").write_text(content)
        with open_library(library.root) as reopened:
            reason = reopened.reconstructions.get(stored.id).damaged
            assert reason is not None
            assert reason.startswith("reconstruction.json: ")
            assert str(library.root) not in reason

    @pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
    def test_points_that_are_cut_off(self, library, stored, share: float) -> None:  # type: ignore[no-untyped-def]
        path = library.root / "reconstructions" / stored.id / "points.npz"
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])
        for ask in (library.reconstructions.load_points, lambda i: library.reconstructions.artefact(i, "depth.png")):
            with pytest.raises(DamagedError, match=r"points\.npz: not readable as arrays") as caught:
                ask(stored.id)
            assert str(library.root) not in str(caught.value)
        assert list((library.root / ".work").iterdir()) == []

    def test_phases_that_are_cut_off(self, library, stored) -> None:  # type: ignore[no-untyped-def]
        path = library.root / "reconstructions" / stored.id / "phases.npz"
        path.write_bytes(path.read_bytes()[:500])
        with pytest.raises(DamagedError, match=r"phases\.npz"):
            library.reconstructions.artefact(stored.id, "phase/high/left.png")


class TestPointFiles:
    @pytest.mark.parametrize("compressed", [False, True])
    def test_round_trip(self, tmp_path: Path, compressed: bool) -> None:
        points = make_points(4)
        write_npz(points, tmp_path / "a.npz", compressed=compressed)
        assert same_points(read_npz(tmp_path / "a.npz"), points)

    @pytest.mark.parametrize(
        ("name", "array"),
        [
            ("points", np.zeros((24, 32, 2), np.float32)),
            ("confidence", np.zeros((24, 31), np.float32)),
            ("normals", np.zeros((24, 32, 3), np.float64)),
            ("mask", np.zeros((24, 32), np.int16)),
            ("mask", np.zeros((24, 32, 1), np.uint8)),
            ("origin", np.full((24, 32), None, object)),
        ],
    )
    def test_other_arrays_are_refused(self, tmp_path: Path, name: str, array: np.ndarray) -> None:
        points = make_points()
        arrays = {n: getattr(points, n) for n in ARRAYS} | {name: array}
        np.savez(tmp_path / "a.npz", **arrays)
        with pytest.raises(Exception, match=r"a\.npz: ") as caught:
            read_npz(tmp_path / "a.npz")
        assert type(caught.value).__name__ == "ReconstructionError"

    def test_missing_arrays_are_refused(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "a.npz", points=np.zeros(3))
        with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
            archive.writestr("points.npy", b"\x93NUMPY\x01\x00\x04\x00((((")
        for name in ("a.npz", "b.npz", "c.npz"):
            with pytest.raises(Exception, match="not readable as arrays"):
                read_npz(tmp_path / name)


class _Page(html.parser.HTMLParser):
    """Tags that opened, texts, and every address that the page names."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


class TestReport:
    def test_it_stands_alone(self, library, stored) -> None:  # type: ignore[no-untyped-def]
        page = _Page(library.reconstructions.report(stored.id))
        assert len(page.addresses) == 6
        for address in page.addresses:
            head, _, data = address.partition(",")
            assert head == "data:image/png;base64"
            assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR).shape == (24, 32, 3)
        assert {"script", "link", "iframe", "object", "form", "base"}.isdisjoint(page.tags)
        shown = " ".join(page.texts)
        for text in (stored.id, "wft", "stereo", "400.0 to 700.0 mm", "saturated", "0.100 s", "32 x 24 px", "job"):
            assert text in shown

    def test_pictures_may_be_links(self, library, stored) -> None:  # type: ignore[no-untyped-def]
        links = {"depth.png": "depth.png?a=1&b=2", "phase/high/left.png": 'x"onerror="alert(1)'}
        page = _Page(library.reconstructions.report(stored.id, links))
        assert page.addresses == list(links.values())

    def test_every_text_is_escaped(self, library, result) -> None:  # type: ignore[no-untyped-def]
        evil = "<script>alert('1')</script><img src=x onerror=y>\""
        stored = library.reconstructions.add(result, ABSENT, {"warnings": [evil, {evil: 1}], evil: evil, "n": [evil]})
        text = library.reconstructions.report(stored.id, {})
        assert "<script" not in text
        assert "<img" not in text
        assert sum(evil in shown for shown in _Page(text).texts) >= 3
