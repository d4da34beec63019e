"""The exposure assistant on a rig whose light obeys, and on one that only replays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_rig import recorded_rig

from drivers.camera import CameraSettings
from drivers.projector import ProjectorSettings
from drivers.simulator.devices import SimulatedSource
from drivers.virtual.rig import bench_of, virtual_rig
from models.capture import Image
from models.geometry.rig import Side
from models.patterns import Pattern
from service.acquisition.cancellation import CaptureCancelledError
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.request import AssistRequest, CaptureRequest

ASK = AssistRequest()


@pytest.fixture(scope="module")
def simulated() -> Iterator[Orchestrator]:
    orchestrator = Orchestrator(virtual_rig(SimulatedSource(3, 2), realtime=False))
    orchestrator.connect()
    yield orchestrator
    orchestrator.close()


def _start(orchestrator: Orchestrator, exposure_us: float, gain_db: float, brightness: float) -> None:
    for side in ("left", "right"):
        settings = CameraSettings(exposure_us=exposure_us, gain_db=gain_db)
        orchestrator.configure_camera(side, settings)  # type: ignore[arg-type]
    orchestrator.configure_projector(ProjectorSettings(brightness=brightness))


@pytest.mark.parametrize(
    ("exposure_us", "gain_db", "brightness"), [(8333, 0, 1), (8333, 0, 0.05), (60_000, 12, 1), (200_000, 24, 1)]
)
def test_the_range_is_filled_from_any_start(
    simulated: Orchestrator, exposure_us: float, gain_db: float, brightness: float
) -> None:
    """The white image of a capture taken with the settings found reads what was asked for, and does not saturate."""
    _start(simulated, exposure_us, gain_db, brightness)
    found = simulated.assist(ASK)
    assert found.reached, found.reason
    assert simulated.settings == found.settings
    capture = simulated.capture(CaptureRequest(plan="reference")).capture
    for side in ("left", "right"):
        white = capture.images[side]["white"].astype(float)  # type: ignore[index]
        lit = white - capture.images[side]["black"] > 8  # type: ignore[index]
        assert np.percentile(white[lit], 99) / 255 == pytest.approx(ASK.target, abs=0.08)


def test_settings_are_only_reported_where_they_are_not_to_be_applied(simulated: Orchestrator) -> None:
    _start(simulated, 8333, 0, 0.3)
    before = simulated.settings
    assert simulated.assist(AssistRequest(apply=False)).reached
    assert simulated.settings == before


def test_a_dark_lamp_is_told(simulated: Orchestrator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no light is seen at all, the reason is the light and not the settings."""
    _start(simulated, 8333, 0, 1)
    source = bench_of(simulated.devices).source
    lit = source.view

    def unlit(side: Side, pattern: Pattern | None, *args: Any, **options: Any) -> Image:
        return lit(side, None, *args, **options)

    monkeypatch.setattr(source, "view", unlit)
    found = simulated.assist(ASK)
    assert not found.reached
    assert "light is not seen" in found.reason


def test_recorded_images_do_not_obey(full_capture: Path) -> None:
    rig = recorded_rig(full_capture)
    before = rig.orchestrator.settings
    found = rig.orchestrator.assist(AssistRequest(target=0.3))
    assert not found.reached
    assert "do not follow" in found.reason
    assert rig.orchestrator.settings == before
    assert rig.is_safe
    rig.orchestrator.close()


def test_it_can_be_cancelled(simulated: Orchestrator, monkeypatch: pytest.MonkeyPatch) -> None:
    _start(simulated, 8333, 0, 0.05)
    camera = simulated.devices.left
    original = camera.configure

    def configure(settings: CameraSettings) -> object:
        simulated.cancel()
        return original(settings)

    monkeypatch.setattr(camera, "configure", configure)
    with pytest.raises(CaptureCancelledError):
        simulated.assist(ASK)
    assert simulated.holder is None
