"""Emulated controllers on the benches of the tests, over real pyusb and real pyserial."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.lightcrafter.bridges import BusPirate, UsbIss
from drivers.lightcrafter.emulator.bench import emulated_controller
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.i2c_device import EmulatedBusPirate, EmulatedUsbIss, I2cSlave
from drivers.lightcrafter.emulator.serial_port import EmulatedSerialPort
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.serial import SerialTransport
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.transport import Transport
from drivers.lightcrafter.usb import UsbTransport
from drivers.projector import ProjectorState
from models.patterns import FringeParameters, Raster, make_plan

PARAMETERS = FringeParameters(exposure_us=8333.0)
PLAN = make_plan("full", PARAMETERS)
MANIFEST = FlashManifest.packed(PLAN)
SMALL = Raster(40, 24, "diamond")
"""Mirrors of an emulated controller that is made often."""
SLOW = PLAN.restricted_to(["white", "high_00", "high_01", "gray_00"])
Made = tuple[LightCrafter, EmulatedController]
BRIDGES = {"usb-iss": (UsbIss, EmulatedUsbIss), "bus-pirate": (BusPirate, EmulatedBusPirate)}


def quick(**settings: Any) -> LightCrafterConfiguration:
    """Settings that wait as little as an emulated controller allows."""
    defaults = {"pacing_s": 0.002, "validate_first_s": 0.0, "image_load_us": 40_000.0, "settle_s": 1.0, "wake_s": 0.05}
    return LightCrafterConfiguration(**{**defaults, "timeout_s": 1.0, **settings})


def controller(**settings: Any) -> EmulatedController:
    return emulated_controller(MANIFEST, SMALL, **{"validation_s": 0.005, "wake_s": 0.1, **settings})


def usb_transport(device: EmulatedController, timeout_s: float = 1.0) -> tuple[UsbTransport, EmulatedUsb]:
    backend = EmulatedUsb(device)
    return UsbTransport(timeout_s=timeout_s, backend=backend), backend


def usb_projector(device: EmulatedController, manifest: FlashManifest = MANIFEST, **settings: Any) -> LightCrafter:
    configuration = quick(**settings)
    return LightCrafter(usb_transport(device, configuration.timeout_s)[0], manifest, configuration)


@contextmanager
def serial_port(
    device: EmulatedController, bridge: str, folder: Path
) -> Iterator[tuple[Transport, EmulatedSerialPort]]:
    """A transport on a port of its own, not yet open, and the port."""
    ours, theirs = BRIDGES[bridge]
    port = EmulatedSerialPort(theirs(I2cSlave(device)), folder / "tty")
    try:
        yield SerialTransport(str(port.path), ours(), timeout_s=1.0, pacing_s=0.0), port
    finally:
        port.unplug()


def wait_until(condition: Callable[[], bool], patience_s: float = 2.0) -> bool:
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.002)
    return True


def wait_for_end(projector: LightCrafter) -> None:
    assert wait_until(lambda: projector.state is ProjectorState.LOADED)
