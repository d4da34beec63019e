"""Recorded captures that the tests of acquisition replay."""

from __future__ import annotations

from pathlib import Path

import pytest
from simulated_captures import plate_before_wall

from models.capture import write_capture


@pytest.fixture(scope="session")
def full_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one recorded capture of the plan full, named "plate"."""
    folder = tmp_path_factory.mktemp("recorded")
    write_capture(plate_before_wall(), folder / "plate")
    return folder
