"""The README's example of the service, run as it stands."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parents[1]


def _example() -> str:
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if "capture-and-reconstruct" in block]
    return str(block)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_the_example_with_curl_ends_in_a_cloud_on_disk(tmp_path: Path) -> None:
    """Only what a test cannot have is replaced: the program's folder and the port."""
    port = _free_port()
    program = Path(sys.executable).with_name("duofringe")
    script = _example().replace(".venv/bin/duofringe", str(program)).replace("localhost:8000", f"localhost:{port}")
    environment = {**os.environ, "DUOFRINGE_SERVER__PORT": str(port)}
    finished = subprocess.run(
        ["bash", "-m", "-e", "-c", script + "\nwait\n"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    cloud = trimesh.load(tmp_path / "cloud.ply")
    points = np.asarray(cloud.vertices)
    assert len(points) > 50_000
    assert 400 < np.median(points[:, 2]) < 670
