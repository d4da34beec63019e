"""Captures over REST: take, list, look at, move, delete, and what is said when that cannot be."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import pytest
from problem_checks import problem
from small_service import SmallService

from models.capture import read_capture
from models.errors import DuofringeError
from service.library import DiskFullError

MISSING = "0199c0de-7a11-7000-8000-000000000000"


def take(small: SmallService, **request: object) -> dict:
    response = small.client.post("/v1/captures", json=request)
    assert response.status_code == 201, response.text
    return response.json()


def test_a_capture_is_stored_as_it_is_told(small: SmallService) -> None:
    response = small.client.post(
        "/v1/captures", json={"plan": "full", "notes": "first", "object_id": "vase", "exposure_us": 9000}
    )
    taken = response.json()
    assert response.headers["location"] == taken["links"]["self"]
    assert small.folders == [taken["id"]]
    stored = read_capture(small.service.library.root / "captures" / taken["id"])
    assert taken["patterns"] == list(stored.plan.names)
    assert taken["plan"] == "full"
    assert (taken["object_id"], taken["extra"]["notes"]) == ("vase", "first")
    assert stored.record.settings["exposure_us"] == taken["settings"]["exposure_us"] == 9000
    assert {"load", "expose", "audit", "store", "total"} <= set(taken["timings_s"])
    found = small.client.get(taken["links"]["self"]).json()
    assert found == {name: taken[name] for name in found}
    assert not found["damaged"]


def test_an_image_is_the_stored_file(small: SmallService) -> None:
    taken = take(small, plan="composite")
    for side in ("left", "right"):
        response = small.client.get(f"/v1/captures/{taken['id']}/images/{side}/composite.png")
        assert response.headers["content-type"] == "image/png"
        folder = small.service.library.root / "captures" / taken["id"]
        assert response.content == (folder / side / "composite.png").read_bytes()


def test_an_archive_comes_back_as_another_capture(small: SmallService) -> None:
    taken = take(small, plan="full")
    response = small.client.get(taken["links"]["archive"])
    assert response.headers["content-type"] == "application/zip"
    assert int(response.headers["content-length"]) == len(response.content)
    assert zipfile.ZipFile(io.BytesIO(response.content)).testzip() is None
    again = small.client.post(
        "/v1/captures/import", content=response.content, headers={"Content-Type": "application/zip"}
    )
    assert again.status_code == 201, again.text
    imported = again.json()
    assert again.headers["location"] == imported["links"]["self"]
    assert imported["id"] != taken["id"]
    assert imported["extra"]["imported_id"] == taken["id"]
    for name, link in taken["links"].items():
        if name.startswith("image_"):
            other = imported["links"][name]
            assert small.client.get(other).content == small.client.get(link).content
    same = small.client.post("/v1/reconstructions", json={"capture": imported["id"]})
    assert same.status_code == 201


def test_a_deleted_capture_is_gone_and_its_reconstruction_stays(small: SmallService) -> None:
    answer = small.client.post("/v1/capture-and-reconstruct").json()
    capture, reconstruction = answer["capture"]["links"]["self"], answer["links"]["self"]
    assert small.client.delete(capture).status_code == 204
    problem(small.client.get(capture), 404, "not-found")
    problem(small.client.delete(capture), 404, "not-found")
    assert small.folders == []
    assert small.client.get(reconstruction).status_code == 200
    assert small.client.get(answer["links"]["ply"]).status_code == 200


def test_pages_follow_their_links(small: SmallService) -> None:
    taken = [take(small, plan=plan)["id"] for plan in ("composite", "reference", "composite", "composite", "reference")]

    def follow(url: str | None) -> list[str]:
        found: list[str] = []
        while url is not None:
            response = small.client.get(url)
            page = response.json()
            assert len(page["items"]) <= 2
            found += [item["id"] for item in page["items"]]
            link = response.headers.get("link")
            assert (link is None) == (page["next"] is None)
            url = None
            if link is not None:
                assert link.endswith('>; rel="next"')
                url = link.removeprefix("<").partition(">")[0]
                assert page["next"] in url
        return found

    assert follow("/v1/captures?limit=2") == taken[::-1]
    assert follow("/v1/captures?limit=2&plan=composite") == [taken[3], taken[2], taken[0]]
    assert follow("/v1/captures?limit=2&object_id=object%201") == [taken[4], taken[2], taken[0]]
    assert follow("/v1/captures?limit=2&plan=full") == []


@pytest.mark.parametrize("query", ["limit=0", "limit=201", "limit=two", f"cursor={'x' * 201}"])
def test_a_page_that_cannot_be_is_refused(lasting: SmallService, query: str) -> None:
    body = problem(lasting.client.get(f"/v1/captures?{query}"), 422, "validation")
    assert body["errors"][0]["field"] == f"query.{query.partition('=')[0]}"


@pytest.mark.parametrize("cursor", ["x", "bjAx", "%00", "é", "bjAxYTIwNDk5LTcwYzgtNzczOC1hMDNkLWVhMjQ3YTRjMGI4OB"])
def test_a_cursor_of_nobody_is_refused(lasting: SmallService, cursor: str) -> None:
    for what in ("captures", "reconstructions"):
        problem(lasting.client.get(f"/v1/{what}?cursor={cursor}"), 422, "cursor-invalid")


@pytest.mark.parametrize("name", [MISSING, "x", "x" * 300, "%00", "..", "%2e%2e", "capture.json", ".lock"])
@pytest.mark.parametrize("rest", ["", "/archive.zip", "/images/left/composite.png"])
def test_an_id_of_nothing_is_not_found(lasting: SmallService, name: str, rest: str) -> None:
    response = lasting.client.get(f"/v1/captures/{name}{rest}")
    assert response.status_code in (404, 405)
    problem(response, response.status_code, "not-found" if response.status_code == 404 else "method-not-allowed")


def test_an_image_that_was_not_taken_is_not_found(small: SmallService) -> None:
    here = f"/v1/captures/{take(small)['id']}/images"
    problem(small.client.get(f"{here}/left/white.png"), 404, "not-found")
    problem(small.client.get(f"{here}/left/..%2f..%2fcapture.png"), 404, "not-found")
    body = problem(small.client.get(f"{here}/middle/composite.png"), 422, "validation")
    assert body["errors"][0]["field"] == "path.side"


@pytest.mark.parametrize(
    ("request_", "slug"),
    [
        ({"plan": "nothing"}, "plan-invalid"),
        ({"plan": []}, "plan-invalid"),
        ({"plan": ["high_00"]}, "plan-invalid"),
        ({"plan": ["composite", "composite"]}, "plan-invalid"),
        ({"plan": ["\ud800"]}, "plan-invalid"),
        ({"scene": "nowhere"}, "scene-unknown"),
        ({"scene": "../plate-1"}, "scene-unknown"),
        ({"exposure_us": 1}, "setting-invalid"),
        ({"exposure_us": 5000}, "sequence-invalid"),
    ],
)
def test_what_the_rig_cannot_do_is_refused_before_any_light(
    lasting: SmallService, request_: dict[str, object], slug: str
) -> None:
    before = lasting.bench.pulses_sent, lasting.folders
    response = lasting.client.post(
        "/v1/captures", content=json.dumps(request_), headers={"Content-Type": "application/json"}
    )
    body = problem(response, 422, slug)
    if slug == "setting-invalid":
        assert body["errors"][0]["field"] == "exposure_us"
    assert (lasting.bench.pulses_sent, lasting.folders) == before


def test_a_full_disk_refuses_before_any_light(small: SmallService, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise DiskFullError("the library's disk is full")

    archive = small.client.get(take(small)["links"]["archive"]).content
    pulses = small.bench.pulses_sent
    monkeypatch.setattr(small.service.library, "require_space", full)
    problem(small.client.post("/v1/captures", json={}), 507, "disk-full")
    problem(small.client.post("/v1/capture-and-reconstruct"), 507, "disk-full")
    response = small.client.post("/v1/captures/import", content=archive, headers={"Content-Type": "application/zip"})
    problem(response, 507, "disk-full")
    assert small.bench.pulses_sent == pulses
    assert list(small.service.library.work.iterdir()) == []


def test_a_damaged_capture_is_listed_and_says_what_is_wrong(small: SmallService, recorded: Path) -> None:
    taken = take(small)
    folder = small.service.library.root / "captures" / taken["id"]
    (folder / "left" / "composite.png").write_bytes(b"no image")
    body = problem(small.client.post("/v1/reconstructions", json={"capture": taken["id"]}), 422, "damaged")
    assert "composite.png" in body["detail"]
    assert str(folder.parent) not in body["detail"]


def test_an_error_of_a_kind_nobody_listed_is_still_told(small: SmallService, monkeypatch: pytest.MonkeyPatch) -> None:
    class UnlistedError(DuofringeError):
        pass

    def fail(*_: object, **__: object) -> None:
        raise UnlistedError("the lamp sings")

    monkeypatch.setattr(small.service.orchestrator, "capture", fail)
    body = problem(small.client.post("/v1/captures", json={}), 422, "request-failed")
    assert body["detail"] == "the lamp sings"
