"""What comes out at the end: points, and what becomes of a mistake on the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from small_rig import DEPTH_RANGE, simulated_source

from benchmarks.virtual_bench import accuracy
from drivers.bench import VirtualBench
from drivers.bench.devices import devices_of
from drivers.lightcrafter.manifest import FlashManifest, StoredPattern
from models.capture import read_capture
from models.export.npz import read_npz
from models.patterns import make_plan
from models.reconstruct import ReconstructionOptions, reconstruct
from service.acquisition.finding import Fault
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.outcome import SequenceRefusedError
from service.acquisition.request import CaptureRequest
from service.acquisition.settings import AcquisitionSettings
from service.app import create_app, open_service
from service.settings import load_settings

MANIFEST = FlashManifest.packed(make_plan("full"))


def test_points_are_as_good_as_on_the_simulated_rig(aravis: None) -> None:
    """The whole way: pyusb, controller, trigger, GigE Vision, libaravis, audit, N-step points."""
    direct, bench = accuracy("simulated", 1), accuracy("bench", 1)
    assert direct["acc1"][0] > 95
    assert abs(bench["acc1"][0] - direct["acc1"][0]) <= 0.5
    assert abs(bench["valid"][0] - direct["valid"][0]) <= 0.5


@pytest.fixture
def client(aravis: None, tmp_path: Path) -> Iterator[TestClient]:
    settings = load_settings(None, {"rig": {"driver": "bench"}, "library": {"folder": tmp_path / "library"}})
    with TestClient(create_app(open_service(settings)), base_url="http://localhost") as client:
        yield client


def test_capture_and_reconstruct_through_the_service(client: TestClient, tmp_path: Path) -> None:
    rig = client.get("/v1/rig").json()
    assert rig["connected"]
    assert rig["simulated"]
    assert [device["driver"] for device in rig["devices"]] == ["aravis", "aravis", "lightcrafter"]
    response = client.post("/v1/capture-and-reconstruct", json={"plan": "full", "scene": "1", "method": "nstep"})
    assert response.status_code == 201, response.text
    answer = response.json()
    captured = read_capture(tmp_path / "library" / "captures" / answer["capture"]["id"])
    assert len(captured.plan) == 33
    assert (captured.record.model_extra or {})["scene"]["name"] == "1"
    points = client.get(answer["links"]["npz"])
    (tmp_path / "points.npz").write_bytes(points.content)
    found = read_npz(tmp_path / "points.npz")
    assert captured.truth is not None
    off = np.abs(found.points[..., 2] - captured.truth.depth)
    seen = np.isfinite(off)
    assert seen.mean() > 0.3
    assert np.median(off[seen]) < 0.1


def _exchanged(manifest: FlashManifest, first: str, second: str) -> FlashManifest:
    """The manifest of somebody who confused two patterns as they packed them."""
    places = {stored.pattern.name: stored for stored in manifest.patterns}
    places[first], places[second] = (
        StoredPattern(pattern=places[mine].pattern, **places[other].model_dump(include={"image", "number", "depth"}))
        for mine, other in ((first, second), (second, first))
    )
    return FlashManifest(patterns=tuple(places[stored.pattern.name] for stored in manifest.patterns))


@pytest.mark.parametrize(("first", "second"), [("high_02", "high_05"), ("high_01", "low_01"), ("gray_00", "gray_03")])
def test_a_packing_mistake_is_seen(aravis: None, first: str, second: str) -> None:
    """What the flash holds is not what the manifest says: the frames are all there and in time, and show it."""
    virtual = VirtualBench(source=simulated_source(), manifest=_exchanged(MANIFEST, first, second))
    orchestrator = Orchestrator(devices_of(virtual, manifest=MANIFEST), AcquisitionSettings(retakes=0, late_s=0.5))
    try:
        orchestrator.connect()
        with pytest.raises(SequenceRefusedError) as caught:
            orchestrator.capture(CaptureRequest(plan="full"))
    finally:
        orchestrator.close()
    named = {finding.pattern for finding in caught.value.findings if finding.fault is Fault.ORDER}
    assert named & {first, second}, [finding.message for finding in caught.value.findings]


def test_settings_reach_the_sensor(aravis: None) -> None:
    """Exposure, gain, depth and lamp are those of the registers, not of the request."""
    virtual = VirtualBench(source=simulated_source())
    orchestrator = Orchestrator(devices_of(virtual), AcquisitionSettings(retakes=2, late_s=0.5))
    try:
        orchestrator.connect()

        def brightness(**request: object) -> float:
            outcome = orchestrator.capture(CaptureRequest.model_validate({"plan": "full", **request}))
            return float(np.mean(outcome.capture.images["left"]["white"])) / outcome.capture.record.white_level

        plain = brightness()
        assert brightness(exposure_us=10_000) == pytest.approx(plain * 10_000 / 8333, rel=0.06)
        projector = orchestrator.settings.projector
        orchestrator.configure_projector(projector.model_copy(update={"brightness": 0.5}))
        assert brightness() == pytest.approx(plain / 2, rel=0.1)
        orchestrator.configure_projector(projector)
        for side, camera in orchestrator.settings.cameras.items():
            orchestrator.configure_camera(side, camera.model_copy(update={"bit_depth": 12}))
        assert brightness() == pytest.approx(plain, rel=0.02)
    finally:
        orchestrator.close()


def test_without_a_trigger_wire_in_steps(aravis: None) -> None:
    """Each pattern is held by the controller, each frame called for; the wires are cut."""
    virtual = VirtualBench(source=simulated_source())
    virtual.wiring.cut.update(("left", "right"))
    orchestrator = Orchestrator(devices_of(virtual), AcquisitionSettings(retakes=2, trigger="software"))
    try:
        orchestrator.connect()
        capture = orchestrator.capture(CaptureRequest(plan="full")).capture
    finally:
        orchestrator.close()
    result = reconstruct(capture, ReconstructionOptions("nstep", None, DEPTH_RANGE))
    assert capture.truth is not None
    off = np.abs(result.points.depth - capture.truth.depth)
    seen = np.isfinite(off)
    assert seen.mean() > 0.3
    assert np.median(off[seen]) < 0.1
