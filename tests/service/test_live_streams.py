"""The live view over MJPEG: it gives way to captures, costs nothing once nobody looks, and ends with the service."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import httpx2
import numpy as np
import pytest
import uvicorn
from small_service import SmallService, small_service

from benchmarks.service_process import ServiceProcess
from benchmarks.service_streams import Viewer, run_rounds, wait_for
from drivers.camera import CameraState
from drivers.projector import ProjectorState
from drivers.replay.source import ReplaySource

ROUNDS = 10


def test_frames_are_pictures_of_the_camera(live: ServiceProcess) -> None:
    with live.client() as client, client.stream("GET", "/v1/rig/cameras/right/stream") as response:
        assert response.headers["content-type"] == "multipart/x-mixed-replace; boundary=duofringe-frame"
        content = b""
        for chunk in response.iter_raw():
            content += chunk
            if content.count(b"--duofringe-frame\r\n") > 3:
                break
    parts = content.split(b"--duofringe-frame\r\n")[1:4]
    for part in parts:
        head, _, image = part.partition(b"\r\n\r\n")
        fields = dict(line.split(": ", 1) for line in head.decode().split("\r\n"))
        assert fields["Content-Type"] == "image/jpeg"
        image = image.removesuffix(b"\r\n")
        assert len(image) == int(fields["Content-Length"])
        assert cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED).shape == (480, 640)


def test_viewers_of_both_cameras_and_previews_share_one_view(live: ServiceProcess) -> None:
    with Viewer(live) as first, Viewer(live) as second, live.client() as client:
        for side in ("left", "right"):
            assert client.get(f"/v1/rig/cameras/{side}/preview").status_code == 200
        count = len(first.frames), len(second.frames)
        wait_for(lambda: len(first.frames) > count[0] + 2 and len(second.frames) > count[1] + 2, "frames for both")
        assert not first.ended


def test_rounds_give_back_all_they_took_and_a_signal_ends_the_last(recorded: Path, tmp_path: Path) -> None:
    """That no frame comes during the exposures is checked in each round."""
    with ServiceProcess(tmp_path, ["--replay", str(recorded)]) as service:
        before, after, pauses = run_rounds(service, ROUNDS)
        assert after == before
        assert len(pauses) == ROUNDS
        with Viewer(service) as viewer:
            started = time.monotonic()
            assert service.terminate() == 0
            assert time.monotonic() - started < 3.0
            wait_for(lambda: viewer.ended, "the end of the stream")
        assert "Traceback" not in service.log


def test_a_signal_ends_a_capture_and_a_stream_at_once(recorded: Path, tmp_path: Path) -> None:
    with ServiceProcess(tmp_path, ["--replay", str(recorded)]) as service, Viewer(service) as viewer:
        answers: list[httpx2.Response] = []

        def capture() -> None:
            with service.client() as client:
                answers.append(client.post("/v1/captures", json={"plan": "full", "exposure_us": 300_000}))

        asking = threading.Thread(target=capture)
        asking.start()
        with service.client() as client:
            wait_for(lambda: client.get("/v1/rig").json()["busy"] == "capture", "the capture")
        time.sleep(1.0)
        started = time.monotonic()
        assert service.terminate() == 0
        assert time.monotonic() - started < 3.0
        wait_for(lambda: viewer.ended, "the end of the stream")
        asking.join(5)
        assert answers[0].status_code == 409
        assert answers[0].json()["type"] == "/v1/problems/capture-cancelled"
        assert "Traceback" not in service.log
        assert list((service.library / "captures").iterdir()) == []


@pytest.fixture
def served(recorded: Path, tmp_path: Path) -> Iterator[tuple[SmallService, uvicorn.Server, str]]:
    """A small service behind a real socket, in a thread of this process."""
    with small_service(ReplaySource(recorded), tmp_path / "library", realtime=True) as small:
        options = uvicorn.Config(small.app, port=0, lifespan="off", log_config=None)
        server = uvicorn.Server(options)
        loops: list[asyncio.AbstractEventLoop] = []

        async def run() -> None:
            loops.append(asyncio.get_running_loop())
            await server.serve()

        serving = threading.Thread(target=lambda: asyncio.run(run()))
        serving.start()
        wait_for(lambda: server.started, "the server")
        server.loop = loops[0]  # type: ignore[attr-defined]
        yield small, server, f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
        server.should_exit = True
        serving.join(10)


def test_a_viewer_that_vanishes_is_noticed(served: tuple[SmallService, uvicorn.Server, str]) -> None:
    small, server, url = served
    live, devices = small.service.orchestrator.live, small.service.orchestrator.devices
    loop: asyncio.AbstractEventLoop = server.loop  # type: ignore[attr-defined]
    with httpx2.Client(base_url=url) as client:
        client.get("/v1/health/live")
        tasks = len(asyncio.all_tasks(loop))
        for side in ("left", "right", "left"):
            with client.stream("GET", f"/v1/rig/cameras/{side}/stream") as response:
                parts = response.iter_raw()
                next(parts)
                assert live.watchers[side] == 1  # type: ignore[index]
                assert live.running
            wait_for(lambda: not any(live.watchers.values()) and not live.running, "nobody to watch")
        wait_for(lambda: not any(t.name == "duofringe-live" for t in threading.enumerate()), "the view's thread to end")
        client.get("/v1/health/live")
        wait_for(lambda: len(asyncio.all_tasks(loop)) <= tasks, "the tasks of the streams to end")
    assert all(camera.state is not CameraState.ARMED for camera in devices.cameras.values())
    assert devices.projector.state is not ProjectorState.HOLDING
    assert small.bench.shown is None


def test_the_end_of_the_service_leaves_the_rig_safe(served: tuple[SmallService, uvicorn.Server, str]) -> None:
    small, _, url = served
    devices = small.service.orchestrator.devices
    with httpx2.Client(base_url=url) as client, client.stream("GET", "/v1/rig/cameras/left/stream") as response:
        parts = response.iter_raw()
        next(parts)
        assert devices.projector.state is ProjectorState.HOLDING
        small.service.close()
        for _ in parts:  # what was under way, then the end
            pass
    assert devices.projector.state is ProjectorState.CLOSED
    assert all(camera.state is CameraState.CLOSED for camera in devices.cameras.values())
    assert small.bench.shown is None


def test_a_stream_outlives_a_rig_that_is_closed_and_opened(
    served: tuple[SmallService, uvicorn.Server, str],
) -> None:
    small, _, url = served
    with (
        httpx2.Client(base_url=url, timeout=10.0) as client,
        httpx2.Client(base_url=url, timeout=10.0) as viewer,
        viewer.stream("GET", "/v1/rig/cameras/left/stream") as response,
    ):
        parts = response.iter_raw()
        next(parts)
        assert client.post("/v1/rig/disconnect").status_code == 200
        time.sleep(0.2)
        assert not small.service.orchestrator.connected
        assert client.post("/v1/rig/connect").status_code == 200
        newest = small.service.orchestrator.live._number
        while small.service.orchestrator.live._number <= newest + 1:
            next(parts)
        assert client.post("/v1/captures", json={}).status_code == 201
        next(parts)
