"""Fixtures that several test files share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from simulated_captures import plate_before_wall

from drivers.aravis.library import load_library
from drivers.errors import DeviceUnavailableError
from models.capture import write_capture
from models.geometry.device import Device
from models.geometry.rig import Rig
from models.patterns import LIGHTCRAFTER_4500
from service.cli import main

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of recorded sets; in CI its absence is a failure."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("DUOFRINGE_DATA") or beside)
    if not folder.is_dir():
        reason = f"recorded sets are not at {folder}; set DUOFRINGE_DATA to their folder"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return folder


@pytest.fixture(scope="session")
def aravis() -> None:
    """libaravis is there; in CI its absence is a failure."""
    try:
        load_library("camera")
    except DeviceUnavailableError as error:
        if os.environ.get("CI") == "true":
            pytest.fail(str(error))
        pytest.skip(str(error))


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the program in this process; returns exit status, stdout, stderr."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return run


@pytest.fixture(scope="session")
def full_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one recorded capture of the plan full, named "plate"."""
    folder = tmp_path_factory.mktemp("recorded")
    write_capture(plate_before_wall(), folder / "plate")
    return folder


def _aimed(centre: tuple[float, float, float], target: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a device at ``centre`` whose axis meets ``target``, without roll."""
    forward = np.subtract(target, centre)
    forward = forward / np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ np.asarray(centre)


@pytest.fixture(scope="session")
def rig() -> Rig:
    """The reference geometry: toed-in cameras 120 mm apart, diamond projector above and between them."""
    camera = np.array([[1000.0, 0, 319.5], [0, 1000, 239.5], [0, 0, 1]])
    projector = np.array([[1086.0, 0, 455.75], [0, 2172, 569.5], [0, 0, 1]])
    target = (0.0, 0.0, 500.0)
    left = Device((640, 480), camera, [-0.1, 0.02, 0.0005, -0.0004, 0.0], name="left")
    right = Device((640, 480), camera, [-0.09, 0.01, 0, 0, 0], *_aimed((120, 0, 0), target), name="right")
    above = Device((912, 1140), projector, [-0.03, 0, 0, 0, 0], *_aimed((60, -60, 0), target), name="projector")
    return Rig(left, right, above, LIGHTCRAFTER_4500, {"date": "2025-01-01"})
