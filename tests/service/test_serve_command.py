"""``duofringe serve``: what it says at the start, and how it refuses."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from benchmarks.service_process import ServiceProcess
from service.cli import main


def test_the_address_told_is_the_one_served(live: ServiceProcess) -> None:
    assert not live.url.endswith(":0")
    with live.client() as client:
        assert client.get("/v1/health/live").json() == {"status": "ok"}


def test_answers_leave_at_once(live: ServiceProcess) -> None:
    """Without TCP_NODELAY every answer would wait for the client's delayed acknowledgement, 40 ms."""
    with live.client() as client:
        fastest = min(client.get("/v1/health/live").elapsed.total_seconds() for _ in range(20))
    assert fastest < 0.03


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_a_port_that_is_taken_is_told_in_one_line(
    host: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DUOFRINGE_LIBRARY__FOLDER", str(tmp_path / "library"))
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as taken:
        try:
            taken.bind((host, 0))
        except OSError:
            pytest.skip("this computer has no such address")
        taken.listen()
        port = str(taken.getsockname()[1])
        with pytest.raises(SystemExit) as ended:
            main(["serve", "--driver", "simulated", "--host", host, "--port", port])
    assert ended.value.code == 1
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert port in line
    assert "--port" in line
    assert not (tmp_path / "library").exists()


def test_a_library_that_another_service_holds_is_told_in_one_line(
    live: ServiceProcess, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DUOFRINGE_LIBRARY__FOLDER", str(live.library))
    with pytest.raises(SystemExit) as ended:
        main(["serve", "--driver", "simulated", "--port", "0"])
    assert ended.value.code == 1
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert str(live.process.pid) in line
