"""Reconstructions over REST."""

from __future__ import annotations

import io
import json
import struct

import cv2
import numpy as np
import pytest
import tifffile
from problem_checks import problem
from small_service import SmallService

MISSING = "0199c0de-7a11-7000-8000-000000000000"
HERE = "/v1/reconstructions"


@pytest.fixture
def capture(small: SmallService) -> str:
    response = small.client.post("/v1/captures", json={"plan": "full"})
    assert response.status_code == 201
    name: str = response.json()["id"]
    return name


def test_files_and_pictures_are_what_they_say(small: SmallService, capture: str) -> None:
    response = small.client.post(HERE, json={"capture": capture, "method": "nstep", "matching": "stereo"})
    assert response.status_code == 201, response.text
    made = response.json()
    here = made["links"]["self"]
    assert response.headers["location"] == here
    assert (made["method"], made["matching"], made["capture"]) == ("nstep", "stereo", capture)
    count = made["statistics"]["points"]
    get = small.client.get
    with np.load(io.BytesIO(get(f"{here}/points.npz").content), allow_pickle=False) as arrays:
        valid = arrays["mask"] == 0
        points = arrays["points"]
    assert int(valid.sum()) == count
    ply = get(f"{here}/points.ply")
    assert ply.headers["content-type"] == "application/vnd.ply"
    assert f"element vertex {count}\n".encode() in ply.content
    assert f"POINTS {valid.size}\n".encode() in get(f"{here}/points.pcd").content
    assert len([line for line in get(f"{here}/points.xyz").text.splitlines() if line[0] != "#"]) == count
    glb = get(f"{here}/points.glb")
    assert glb.headers["content-type"] == "model/gltf-binary"
    assert struct.unpack("<4sII", glb.content[:12]) == (b"glTF", 2, len(glb.content))
    depth = tifffile.imread(io.BytesIO(get(f"{here}/depth.tiff").content))
    np.testing.assert_array_equal(depth[valid], points[..., 2][valid])
    assert np.isnan(depth[~valid]).all()
    for picture in ("depth", "surface", "phase/high/left", "phase/high/right", "phase/low/left", "phase/low/right"):
        found = get(f"{here}/{picture}.png")
        assert found.headers["content-type"] == "image/png", picture
        assert cv2.imdecode(np.frombuffer(found.content, np.uint8), cv2.IMREAD_COLOR).std() > 1


def test_a_report_loads_nothing_from_elsewhere(small: SmallService, capture: str) -> None:
    made = small.client.post(HERE, json={"capture": capture}).json()
    report = small.client.get(made["links"]["report"])
    assert report.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in report.headers["content-security-policy"]
    assert made["id"] in report.text
    assert 'src="http' not in report.text
    assert "<script" not in report.text


def test_lists_hold_those_of_a_capture(small: SmallService, capture: str) -> None:
    other = small.client.post("/v1/captures", json={}).json()["id"]
    made = [small.client.post(HERE, json={"capture": name}).json()["id"] for name in (capture, other, capture, capture)]

    def listed(query: str) -> list[str]:
        return [item["id"] for item in small.client.get(f"{HERE}?{query}").json()["items"]]

    assert listed("limit=10") == made[::-1]
    first = small.client.get(f"{HERE}?limit=2&capture={capture}")
    assert [item["id"] for item in first.json()["items"]] == [made[3], made[2]]
    link = first.headers["link"].removeprefix("<").partition(">")[0]
    second = small.client.get(link).json()
    assert [item["id"] for item in second["items"]] == [made[0]]
    assert second["next"] is None
    assert listed("capture=nobody") == []


def test_a_deleted_reconstruction_is_gone(small: SmallService, capture: str) -> None:
    here = small.client.post(HERE, json={"capture": capture}).json()["links"]["self"]
    assert small.client.delete(here).status_code == 204
    for rest in ("", "/points.ply", "/report", "/depth.png", "/surface.png", "/phase/high/left.png"):
        problem(small.client.get(here + rest), 404, "not-found")
    problem(small.client.delete(here), 404, "not-found")
    assert small.client.get(f"/v1/captures/{capture}").status_code == 200


@pytest.mark.parametrize("name", [MISSING, "x", "%2e%2e%2fcaptures", "..%2f..", "%00"])
def test_an_id_of_nothing_is_not_found(lasting: SmallService, name: str) -> None:
    for rest in ("", "/points.ply", "/report", "/depth.tiff"):
        problem(lasting.client.get(f"{HERE}/{name}{rest}"), 404, "not-found")
    problem(lasting.client.delete(f"{HERE}/{name}"), 404, "not-found")


@pytest.mark.parametrize("capture_", [MISSING, "x", "../x", "", "\x00", "."])
def test_a_capture_of_nothing_is_not_found(lasting: SmallService, capture_: str) -> None:
    problem(lasting.client.post(HERE, json={"capture": capture_}), 404, "not-found")


def test_a_file_of_another_kind_is_refused(small: SmallService, capture: str) -> None:
    here = small.client.post(HERE, json={"capture": capture}).json()["links"]["self"]
    for name in ("points.exe", "depth.jpg", "phase/middle/left.png", "phase/high/both.png"):
        problem(small.client.get(f"{here}/{name}"), 422, "validation")
    problem(small.client.get(f"{here}/record.json"), 404, "not-found")


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        ({}, "body.capture"),
        ({"capture": 7}, "body.capture"),
        ({"capture": "x" * 65}, "body.capture"),
        ({"capture": "x", "method": "magic"}, "body.method"),
        ({"capture": "x", "matching": "none"}, "body.matching"),
        ({"capture": "x", "depth_range": [1]}, "body.depth_range"),
        ({"capture": "x", "depth_range": [2, 1]}, "body"),
        ({"capture": "x", "depth_range": [0, 1]}, "body"),
        ({"capture": "x", "depth_range": [float("nan"), 1]}, "body"),
        ({"capture": "x", "depth_range": [1, float("inf")]}, "body"),
        ({"capture": "x", "device": "gpu"}, "body.device"),
        ({"capture": "x", "device": "cuda:0; rm"}, "body.device"),
        ({"capture": "x", "colour": "red"}, "body.colour"),
    ],
)
def test_a_request_that_says_something_else_is_refused(
    lasting: SmallService, request_: dict[str, object], field: str
) -> None:
    response = lasting.client.post(HERE, content=json.dumps(request_), headers={"Content-Type": "application/json"})
    body = problem(response, 422, "validation")
    assert body["errors"][0]["field"].startswith(field)
    assert body["detail"].startswith(body["errors"][0]["field"])


def test_a_device_that_is_not_here_is_named(small: SmallService, capture: str) -> None:
    body = problem(
        small.client.post(HERE, json={"capture": capture, "device": "cuda:99"}), 422, "reconstruction-failed"
    )
    assert "cuda:99" in body["detail"]


def test_a_method_without_its_patterns_is_refused(small: SmallService) -> None:
    name = small.client.post("/v1/captures", json={"plan": "composite"}).json()["id"]
    body = problem(small.client.post(HERE, json={"capture": name, "method": "nstep"}), 422, "capture-unusable")
    assert "high" in body["detail"]
    assert len(small.service.library.reconstructions) == 0
