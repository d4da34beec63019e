"""Keys: needed where they are configured, and for every address but this computer's own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest
from problem_checks import problem
from small_service import SmallService, small_service

from drivers.replay.source import ReplaySource
from service.cli import main

KEY, OTHER_KEY = "a-key-of-twenty-two-ch", "another-key-of-the-lab"
GOOD = {"Authorization": f"Bearer {KEY}"}


@pytest.fixture(scope="module")
def guarded(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SmallService]:
    library = tmp_path_factory.mktemp("guarded") / "library"
    keys = f"{KEY}, {OTHER_KEY}"
    with small_service(ReplaySource(recorded), library, api_keys=keys, server={"host": "0.0.0.0"}) as running:
        yield running


def protected(guarded: SmallService) -> list[tuple[str, str]]:
    """Every operation that needs a key, with something in place of its parameters."""
    document = guarded.client.get("/openapi.json").json()
    found = [
        (method, path.replace("{side}", "left").replace("{suffix}", "ply").replace("{carrier}", "high"))
        for path, item in document["paths"].items()
        for method, operation in item.items()
        if "security" in operation
    ]
    return [(method, path.replace("{", "").replace("}", "")) for method, path in found]


@pytest.mark.parametrize(
    "given",
    [
        None,
        "",
        "Bearer",
        "Bearer ",
        "Bearer wrong-key-of-some-size",
        f"Bearer {KEY}x",
        f"Bearer {KEY[:-1]}",
        f"Bearer {KEY},{OTHER_KEY}",
        f"Bearer {KEY}, {OTHER_KEY}",
        f"Basic {KEY}",
        KEY,
        "Bearer \xff\xfe",
    ],
)
def test_without_a_good_key_nothing_is_told_or_done(guarded: SmallService, given: str | None) -> None:
    headers = {} if given is None else {"Authorization": given.encode("latin-1")}
    operations = protected(guarded)
    assert len(operations) >= 25
    before = guarded.bench.pulses_sent
    for method, path in operations:
        response: httpx2.Response = guarded.client.request(method, path, headers=headers)
        problem(response, 401, "unauthorized")
        assert response.headers["www-authenticate"] == "Bearer"
        assert KEY not in response.text
    assert guarded.bench.pulses_sent == before


@pytest.mark.parametrize("key", [KEY, OTHER_KEY])
def test_with_a_key_everything_goes(guarded: SmallService, key: str) -> None:
    headers = {"Authorization": f"Bearer {key}"}
    made = guarded.client.post("/v1/capture-and-reconstruct", headers=headers)
    assert made.status_code == 201
    for link in made.json()["links"].values():
        assert guarded.client.get(link, headers=headers).status_code == 200
        problem(guarded.client.get(link), 401, "unauthorized")


def test_a_refused_upload_leaves_nothing(guarded: SmallService) -> None:
    body = (b"PK" * 1000 for _ in range(10))
    response = guarded.client.post("/v1/captures/import", content=body, headers={"Content-Type": "application/zip"})
    problem(response, 401, "unauthorized")
    assert list(guarded.service.library.work.iterdir()) == []


def test_health_problems_and_the_description_need_no_key(guarded: SmallService) -> None:
    for path in ("/v1/health/live", "/v1/health/ready", "/v1/problems", "/docs", "/openapi.json"):
        assert guarded.client.get(path).status_code == 200


def test_a_network_address_is_served_under_any_name_with_a_key(guarded: SmallService) -> None:
    for host in ("192.168.7.7:8000", "bench.example"):
        assert guarded.client.get("/v1/rig", headers={"Host": host, **GOOD}).status_code == 200
        page = {"Host": host, "Origin": "https://elsewhere.example", **GOOD}
        assert guarded.client.post("/v1/rig/cancel", headers=page).status_code == 200


def test_keys_are_not_shown(guarded: SmallService) -> None:
    assert KEY not in repr(guarded.service.settings)
    assert KEY not in str(guarded.service.settings.model_dump())


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "bench.example", ""])
def test_an_open_address_without_keys_is_refused_in_one_line(
    host: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DUOFRINGE_LIBRARY__FOLDER", str(tmp_path / "library"))
    monkeypatch.delenv("DUOFRINGE_API_KEYS", raising=False)
    with pytest.raises(SystemExit) as ended:
        main(["serve", "--driver", "simulated", "--port", "0", "--host", host])
    assert ended.value.code == 1
    written = capfd.readouterr()
    assert len(written.err.strip().splitlines()) == 1
    assert "DUOFRINGE_API_KEYS" in written.err
    assert not (tmp_path / "library").exists()


def test_a_key_that_can_be_guessed_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DUOFRINGE_API_KEYS", f"{KEY},short")
    with pytest.raises(SystemExit) as ended:
        main(["serve", "--driver", "simulated", "--host", "0.0.0.0"])
    assert ended.value.code == 1
    written = capfd.readouterr().err
    assert "at least" in written
    assert "short" not in written.replace("shorter", "")
    assert KEY not in written
