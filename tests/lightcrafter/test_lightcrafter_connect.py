"""Settings of a LightCrafter, and the projector that they make."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from lightcrafter_benches import MANIFEST
from pydantic import ValidationError

from drivers.errors import DeviceConfigurationError, DeviceNotFoundError, DeviceUnavailableError
from drivers.lightcrafter.connect import make_projector, make_transport
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.projector import ProjectorState


def test_settings_without_a_manifest_make_no_projector(tmp_path: Path) -> None:
    with pytest.raises(DeviceConfigurationError, match="manifest cannot be None; name the file"):
        make_projector(LightCrafterConfiguration())
    with pytest.raises(DeviceConfigurationError, match="the file cannot be used"):
        make_projector(LightCrafterConfiguration(manifest=tmp_path / "none.json"))


def test_the_projector_of_the_settings_is_closed_and_looks_for_its_device(tmp_path: Path) -> None:
    """No machine that runs this has one at such a path."""
    MANIFEST.write(tmp_path / "flash.json")
    made = make_projector(LightCrafterConfiguration(manifest=tmp_path / "flash.json", usb_path="99-99"))
    assert made.state is ProjectorState.CLOSED
    with pytest.raises((DeviceNotFoundError, DeviceUnavailableError)):
        made.open()


@pytest.mark.parametrize(("connection", "bridge"), [("usb-iss", "USB-ISS"), ("bus-pirate", "Bus Pirate")])
def test_a_bridge_is_looked_for_at_its_port(connection: Any, bridge: str, tmp_path: Path) -> None:
    port = str(tmp_path / "ttyACM0")
    transport = make_transport(LightCrafterConfiguration(connection=connection, port=port))
    assert transport.location == f"{bridge} at {port}"
    with pytest.raises(DeviceNotFoundError, match="cannot be opened"):
        transport.open()


@pytest.mark.parametrize(
    "settings",
    [
        {"connection": "usb-iss"},
        {"led_limits": (0, 120, 125)},
        {"led_limits": (151, 256, 125)},
        {"dark_us": 230},
        {"i2c_address": 0x80},
        {"hold": "pause"},
        {"unknown": 1},
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        LightCrafterConfiguration(**settings)
