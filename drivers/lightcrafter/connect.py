"""From settings to a projector."""

from __future__ import annotations

from drivers.errors import DeviceConfigurationError
from drivers.lightcrafter.bridges import Bridge, BusPirate, UsbIss
from drivers.lightcrafter.commands import NAME
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.serial import SerialTransport
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.transport import Transport
from drivers.lightcrafter.usb import UsbTransport

_BRIDGE_S = 0.5
"""Longest time that a bridge takes to answer."""


def make_transport(configuration: LightCrafterConfiguration) -> Transport:
    """The way to the controller that the settings name, not yet open."""
    if configuration.connection == "usb":
        return UsbTransport(configuration.usb_path, timeout_s=configuration.timeout_s)
    bridge: Bridge = UsbIss() if configuration.connection == "usb-iss" else BusPirate(pull_ups=configuration.pull_ups)
    assert configuration.port is not None  # the settings see to it
    return SerialTransport(
        configuration.port,
        bridge,
        address=configuration.i2c_address,
        timeout_s=min(_BRIDGE_S, configuration.timeout_s),
        pacing_s=configuration.pacing_s,
        ready_mask=configuration.i2c_ready_mask,
    )


def make_projector(configuration: LightCrafterConfiguration) -> LightCrafter:
    """The projector of the settings, not yet open. Raises DeviceConfigurationError for a missing or bad manifest."""
    if configuration.manifest is None:
        raise DeviceConfigurationError(NAME, "manifest", None, "name the file that says what the flash holds")
    return LightCrafter(make_transport(configuration), FlashManifest.from_file(configuration.manifest), configuration)
