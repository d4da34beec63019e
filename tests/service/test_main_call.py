"""One request, one cloud: the same bit for bit as the library gives on the stored capture."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import httpx2
import numpy as np
import pytest
from problem_checks import problem
from small_rig import DEPTH_RANGE
from small_service import SmallService, small_service

from benchmarks.service_process import ServiceProcess
from drivers.replay.source import ReplaySource
from models.capture import read_capture, write_capture
from models.errors import ReconstructionError
from models.export.npz import write_npz
from models.export.ply import write_ply
from models.foreign.importer import import_capture
from models.reconstruct import Reconstruction, ReconstructionOptions, reconstruct
from service.cli import main
from service.compute import ComputeBusyError, ComputeLane

CALL = "/v1/capture-and-reconstruct"
MANIFEST = Path(__file__).resolve().parents[2] / "examples" / "manifests" / "stereo_small_mit.toml"


def same_npz(served: bytes, other: Path) -> bool:
    with np.load(io.BytesIO(served), allow_pickle=False) as a, np.load(other, allow_pickle=False) as b:
        assert set(a.files) == set(b.files)
        assert len(a.files) == 9
        return all(a[n].dtype == b[n].dtype and a[n].tobytes() == b[n].tobytes() for n in a.files)


def check_against(client: httpx2.Client, answer: dict, expected: Reconstruction, folder: Path) -> None:
    """Cloud and arrays behind the links of an answer are those of a reconstruction of one's own."""
    write_npz(expected.points, folder / "own.npz")
    write_ply(expected.points, folder / "own.ply")
    assert same_npz(client.get(answer["links"]["npz"]).content, folder / "own.npz")
    assert client.get(answer["links"]["ply"]).content == (folder / "own.ply").read_bytes()
    assert answer["reconstruction"]["statistics"]["points"] == len(expected.points) > 1000


@pytest.mark.parametrize("method", ["wft", "nstep", "refiner"])
@pytest.mark.parametrize("rig", ["small", "simulated"])
def test_the_cloud_is_that_of_the_library(
    rig: str, method: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    running: SmallService = request.getfixturevalue(rig)
    response = running.client.post(CALL, json={"method": method, "depth_range": DEPTH_RANGE})
    assert response.status_code == 201, response.text
    answer = response.json()
    assert response.headers["location"] == answer["links"]["self"]
    stored = running.service.library.root / "captures" / answer["capture"]["id"]
    options = ReconstructionOptions(method, None, DEPTH_RANGE)
    check_against(running.client, answer, reconstruct(read_capture(stored), options), tmp_path)


def test_every_link_answers(small: SmallService) -> None:
    answer = small.client.post(CALL, json={"method": "nstep"}).json()
    links = {**answer["links"], **answer["capture"]["links"]}
    assert {"ply", "pcd", "xyz", "npz", "glb", "depth_tiff", "depth_png", "report", "capture", "archive"} <= set(links)
    assert {"phase_high_left_png", "phase_low_right_png"} <= set(links)
    for name, link in links.items():
        found = small.client.get(link)
        assert found.status_code == 200, name
        assert len(found.content) > 100, name
    timings = answer["timings_s"]
    assert timings["total"] >= timings["capture"] + timings["reconstruction"]
    assert 0 < answer["clocks"]["acquisition_s"] <= timings["capture"]


def test_the_cloud_itself_is_the_answer_where_it_is_accepted(small: SmallService) -> None:
    response = small.client.post(CALL, headers={"Accept": "application/vnd.ply"})
    assert response.status_code == 201
    assert response.headers["content-type"] == "application/vnd.ply"
    assert response.content.startswith(b"ply\nformat binary_little_endian")
    found = small.client.get(response.headers["location"]).json()
    assert small.client.get(found["links"]["ply"]).content == response.content
    assert f"<{found['links']['capture']}>" in response.headers["link"]


def test_the_command_line_makes_the_same_files(live: ServiceProcess, tmp_path: Path) -> None:
    with live.client() as client:
        answer = client.post(CALL, json={"method": "wft"}).raise_for_status().json()
        assert answer["capture"]["simulated"]
        capture = live.library / "captures" / answer["capture"]["id"]
        for suffix in ("ply", "npz"):
            with pytest.raises(SystemExit) as ended:
                main(["reconstruct", str(capture), "--method", "wft", "--output", str(tmp_path / f"own.{suffix}")])
            assert ended.value.code in (0, None)
        assert client.get(answer["links"]["ply"]).content == (tmp_path / "own.ply").read_bytes()
        assert same_npz(client.get(answer["links"]["npz"]).content, tmp_path / "own.npz")


def test_a_replayed_rig_says_so_everywhere(small: SmallService) -> None:
    rig = small.client.get("/v1/rig").json()
    assert rig["replayed"]
    assert {device["origin"] for device in rig["devices"]} == {"replayed"}
    first = small.client.post(CALL).json()["capture"]
    second = small.client.post(CALL).json()["capture"]
    named = small.client.post(CALL, json={"scene": "plate-1"}).json()["capture"]
    for capture in (first, second, named):
        assert capture["replayed"]
        assert {device["origin"] for device in capture["devices"]} == {"replayed"}
    assert [c["extra"]["scene"]["name"] for c in (first, second, named)] == ["plate-1", "plate-2", "plate-1"]


@pytest.fixture
def real_rig(real_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[SmallService, Path]]:
    monkeypatch.setattr("service.app.warm_up", lambda _: None)  # seconds at this size
    recorded = tmp_path / "mit"
    write_capture(import_capture(real_data / "stereo_small_mit", MANIFEST), recorded)
    with small_service(ReplaySource(recorded), tmp_path / "library") as running:
        yield running, recorded


@pytest.mark.realdata
def test_a_recorded_set_through_the_service(real_rig: tuple[SmallService, Path], tmp_path: Path) -> None:
    running, recorded = real_rig
    response = running.client.post(CALL, json={"method": "nstep", "depth_range": [800, 1020]})
    assert response.status_code == 201, response.text
    answer = response.json()
    assert answer["capture"]["replayed"]
    stored = read_capture(running.service.library.root / "captures" / answer["capture"]["id"])
    original = read_capture(recorded)
    for side in original.sides:
        for name, image in stored.images[side].items():
            np.testing.assert_array_equal(image, original.images[side][name])
    options = ReconstructionOptions("nstep", None, (800.0, 1020.0))
    check_against(running.client, answer, reconstruct(stored, options), tmp_path)


def test_a_capture_that_gives_no_cloud_is_kept_and_named(small: SmallService) -> None:
    response = small.client.post(CALL, json={"depth_range": [5000, 5001]}, headers={"Idempotency-Key": "far"})
    body = problem(response, 422, "captured-not-reconstructed")
    kept = small.client.get(body["capture"])
    assert kept.status_code == 200
    assert small.folders == [kept.json()["id"]]


def test_a_full_compute_lane_does_not_lose_the_capture(small: SmallService, monkeypatch: pytest.MonkeyPatch) -> None:
    def busy(*_: object) -> None:
        raise ComputeBusyError(16)

    monkeypatch.setattr(ComputeLane, "submit", busy)
    response = small.client.post(CALL, json={"method": "wft"})
    body = problem(response, 503, "captured-not-reconstructed")
    assert int(response.headers["retry-after"]) > 0
    assert small.client.get(body["capture"]).status_code == 200


def test_a_cloud_that_cannot_be_stored_does_not_lose_the_capture(
    small: SmallService, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise ReconstructionError("not kept")

    monkeypatch.setattr(small.service.library.reconstructions, "add", refuse)
    body = problem(small.client.post(CALL), 422, "captured-not-reconstructed")
    assert small.client.get(body["capture"]).status_code == 200


def test_a_plan_without_what_the_method_needs_is_refused_before_any_light(small: SmallService) -> None:
    problem(small.client.post(CALL, json={"method": "nstep", "plan": "composite"}), 422, "plan-invalid")
    assert small.bench.pulses_sent == 0
    assert small.folders == []
