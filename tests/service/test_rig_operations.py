"""The rig over REST: what it is, its settings, its live picture, and who may move it when."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
import pytest
from problem_checks import problem
from small_service import SmallService

from drivers.virtual.faults import PlantedFault


@contextmanager
def busy(small: SmallService) -> Iterator[None]:
    """Somebody captures until the block ends."""
    with small.service.orchestrator._exclusively("capture"):
        yield


def test_the_rig_tells_what_it_is(simulated: SmallService) -> None:
    rig = simulated.client.get("/v1/rig").json()
    assert rig["connected"]
    assert rig["simulated"]
    assert not rig["replayed"]
    assert rig["busy"] is None
    assert [device["role"] for device in rig["devices"]] == ["left", "right", "projector"]
    left, projector = rig["devices"][0], rig["devices"][2]
    assert left["settings"]["size"] == [192, 96]
    assert left["limits"]["exposure_us"] == [20, 350_000]
    assert "hardware_edge" in left["triggers"]
    assert projector["limits"]["raster"] == {"size": [912, 1140], "kind": "diamond"}
    low, high = rig["calibration"]["working_range_mm"]
    assert 0 < low < high
    assert len(rig["calibration"]["fingerprint"]) == 64
    made = simulated.client.post("/v1/capture-and-reconstruct").json()["reconstruction"]
    assert made["calibration"] == rig["calibration"]["fingerprint"]


def test_settings_hold_for_captures(simulated: SmallService) -> None:
    for side in ("left", "right"):
        changed = simulated.client.patch(f"/v1/rig/cameras/{side}", json={"exposure_us": 10_000, "gain_db": 1.5})
        assert changed.status_code == 200, changed.text
        assert changed.json()["settings"]["exposure_us"] == 10_000
    projector = simulated.client.patch("/v1/rig/projector", json={"brightness": 0.75})
    assert projector.json()["settings"]["brightness"] == 0.75
    settings = simulated.client.post("/v1/captures", json={}).json()["settings"]
    assert (settings["exposure_us"], settings["gain_db"]) == (10_000, 1.5)
    assert settings["projector"]["brightness"] == 0.75
    once = simulated.client.post("/v1/captures", json={"exposure_us": 9_000}).json()["settings"]
    assert once["exposure_us"] == 9_000
    assert simulated.client.get("/v1/rig").json()["devices"][0]["settings"]["exposure_us"] == 10_000


@pytest.mark.parametrize(
    ("path", "change", "slug"),
    [
        ("cameras/left", {"exposure_us": 1e9}, "setting-invalid"),
        ("cameras/left", {"gain_db": -1}, "setting-invalid"),
        ("cameras/left", {"bit_depth": 10}, "validation"),
        ("cameras/left", {"exposure_us": "9000"}, "validation"),
        ("cameras/left", {"exposure_us": True}, "validation"),
        ("cameras/left", {"exposure_us": 0}, "validation"),
        ("cameras/left", {"shutter": 3}, "validation"),
        ("cameras/left", [], "validation"),
        ("cameras/middle", {}, "validation"),
        ("projector", {}, "validation"),
        ("projector", {"brightness": 1.01}, "validation"),
        ("projector", {"brightness": True}, "validation"),
    ],
)
def test_a_setting_that_cannot_be_changes_nothing(lasting: SmallService, path: str, change: object, slug: str) -> None:
    before = lasting.client.get("/v1/rig").json()
    problem(lasting.client.patch(f"/v1/rig/{path}", json=change), 422, slug)
    assert lasting.client.get("/v1/rig").json() == before


def test_the_assistant_finds_settings_and_keeps_them(simulated: SmallService) -> None:
    simulated.client.patch("/v1/rig/projector", json={"brightness": 0.4})
    looked = simulated.client.post("/v1/rig/assist", json={"apply": False}).json()
    assert looked["reached"]
    assert not looked["applied"]
    assert simulated.client.get("/v1/rig").json()["devices"][2]["settings"]["brightness"] == 0.4
    found = simulated.client.post("/v1/rig/assist").json()
    assert found["applied"]
    assert all(0.7 < reading["brightest"] < 1 for reading in found["readings"].values())
    rig = simulated.client.get("/v1/rig").json()
    assert rig["devices"][0]["settings"]["exposure_us"] == found["cameras"]["left"]["exposure_us"]
    assert rig["devices"][2]["settings"]["brightness"] == found["projector"]["brightness"]
    problem(simulated.client.post("/v1/rig/assist", json={"target": 2}), 422, "validation")


def test_a_preview_is_a_picture_of_the_camera(simulated: SmallService) -> None:
    for side in ("left", "right"):
        response = simulated.client.get(f"/v1/rig/cameras/{side}/preview")
        assert response.headers["content-type"] == "image/jpeg"
        assert response.headers["cache-control"] == "no-store"
        picture = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (96, 192)
        assert picture.std() > 5
    for side in ("left", "right"):
        simulated.client.patch(f"/v1/rig/cameras/{side}", json={"exposure_us": 300_000, "bit_depth": 12})
    marked = simulated.client.get("/v1/rig/cameras/left/preview?mark_saturated=true").content
    blue, green, red = cv2.imdecode(np.frombuffer(marked, np.uint8), cv2.IMREAD_COLOR).reshape(-1, 3).T.astype(int)
    assert np.mean((red > 200) & (blue < 60) & (green < 60)) > 0.2


def test_a_disconnected_rig_says_so_until_it_is_connected(small: SmallService) -> None:
    closed = small.client.post("/v1/rig/disconnect").json()
    assert not closed["connected"]
    assert {device["state"] for device in closed["devices"]} == {"closed"}
    assert closed["devices"][0]["origin"] is None
    for method, path, body in (
        ("POST", "/v1/captures", {}),
        ("POST", "/v1/capture-and-reconstruct", {}),
        ("POST", "/v1/rig/assist", {}),
        ("PATCH", "/v1/rig/cameras/left", {"gain_db": 1}),
        ("PATCH", "/v1/rig/projector", {"brightness": 1}),
        ("GET", "/v1/rig/cameras/left/preview", None),
        ("GET", "/v1/rig/cameras/left/stream", None),
    ):
        problem(small.client.request(method, path, json=body), 503, "rig-not-connected")
    ready = small.client.get("/v1/health/ready")
    assert ready.status_code == 503
    assert [(check["name"], check["ok"]) for check in ready.json()["checks"]] == [
        ("rig", False),
        ("storage", True),
        ("weights", True),
    ]
    assert small.client.get("/v1/health/live").json() == {"status": "ok"}
    assert small.client.post("/v1/rig/connect").json()["connected"]
    assert small.client.get("/v1/health/ready").json()["ready"]
    assert small.client.post("/v1/captures", json={}).status_code == 201


def test_a_rig_whose_camera_is_unplugged_names_it(small: SmallService) -> None:
    small.client.post("/v1/rig/disconnect")
    camera = small.service.orchestrator.devices.left
    camera.unplug()  # type: ignore[attr-defined]  # a virtual one
    body = problem(small.client.post("/v1/rig/connect"), 503, "rig-not-connected")
    assert list(body["failures"]) == ["left camera"]
    assert small.client.get("/v1/rig").json()["failures"] == body["failures"]
    assert "cable" in small.client.get("/v1/health/ready").json()["checks"][0]["detail"]
    camera.plug()  # type: ignore[attr-defined]
    assert small.client.post("/v1/rig/connect").json()["failures"] == {}


def test_a_busy_rig_answers_at_once_with_when_to_ask_again(small: SmallService) -> None:
    with busy(small):
        for method, path, body in (
            ("POST", "/v1/captures", {}),
            ("POST", "/v1/capture-and-reconstruct", {}),
            ("POST", "/v1/rig/assist", {}),
            ("POST", "/v1/rig/connect", None),
            ("POST", "/v1/rig/disconnect", None),
            ("PATCH", "/v1/rig/cameras/right", {"gain_db": 1}),
            ("PATCH", "/v1/rig/projector", {"brightness": 1}),
            ("GET", "/v1/rig/cameras/left/preview", None),
        ):
            response = small.client.request(method, path, json=body)
            problem(response, 409, "rig-busy")
            assert int(response.headers["retry-after"]) >= 1
        assert small.client.get("/v1/rig").json()["busy"] == "capture"
        assert small.client.get("/v1/health/ready").json()["ready"]
    assert small.client.post("/v1/captures", json={}).status_code == 201


def test_faults_are_told_one_by_one(small: SmallService) -> None:
    small.bench.plant(PlantedFault("dropped", "right", index=3))
    body = problem(small.client.post("/v1/captures", json={"plan": "full"}), 502, "capture-refused")
    assert body["attempts"] == 1
    assert {finding["device"] for finding in body["findings"]} == {"right camera"}
    assert any(finding["index"] == 3 for finding in body["findings"])
    assert small.folders == []
    assert small.client.post("/v1/captures", json={"plan": "full"}).status_code == 201


def test_a_lost_camera_is_a_fault_and_comes_back(small: SmallService) -> None:
    small.bench.plant(PlantedFault("dead_camera", "left", index=2, sequences=2))
    problem(small.client.post("/v1/captures", json={"plan": "full"}), 502, "capture-refused")
    rig = small.client.get("/v1/rig").json()
    assert not rig["connected"]
    assert list(rig["failures"]) == ["left camera"]
    assert small.client.post("/v1/rig/connect").status_code == 200
    assert small.client.post("/v1/captures", json={"plan": "full"}).status_code == 201


def test_cancelling_ends_a_capture_and_leaves_nothing(small: SmallService, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def endless(*arguments: object) -> None:
        cancellation = arguments[-1]
        begun.set()
        for _ in range(1000):
            cancellation.wait(0.01)  # type: ignore[attr-defined]
        pytest.fail("never cancelled")

    assert small.client.post("/v1/rig/cancel").json() == {"cancelled": False}
    monkeypatch.setattr("service.acquisition.orchestrator.record_sequence", endless)
    answers = []
    asking = threading.Thread(target=lambda: answers.append(small.client.post("/v1/captures", json={})))
    asking.start()
    assert begun.wait(5)
    assert small.client.post("/v1/rig/cancel").json() == {"cancelled": True}
    asking.join(5)
    problem(answers[0], 409, "capture-cancelled")
    assert small.folders == []
    assert small.client.get("/v1/rig").json()["busy"] is None
