"""Simulated cameras on the network and an emulated projector on the USB, with wires between that can be pulled."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack
from typing import Any

from drivers.aravis.camera import AravisCamera
from drivers.devices import RigDevices
from drivers.genicam.configuration import GenicamConfiguration
from drivers.gigevision import SimulatedGrasshopper
from drivers.lightcrafter.emulator.bench import emulated_controller
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import UsbTransport
from models.geometry.rig import SIDES, Side
from models.patterns import FringeParameters, Raster, make_plan

NAMES = ("white", "high_00", "high_01", "high_02", "gray_00", "gray_01", "gray_02", "gray_03", "black")
MANIFEST = FlashManifest.packed(make_plan("full", FringeParameters(exposure_us=8333.0)).restricted_to(NAMES))
_MIRRORS = Raster(40, 24, "diamond")


class EmulatedRig:
    """wires: sides to which the projector's pulses get.

    manifest: what the projector is told of its flash. controller: settings of the emulated one. Others are those of the
    projector's configuration.
    """

    def __init__(
        self, manifest: FlashManifest = MANIFEST, *, controller: dict[str, Any] | None = None, **settings: Any
    ) -> None:
        self.wires: set[Side] = set(SIDES)
        self._started_s = 0.0
        made = {"validation_s": 0.005, **(controller or {})}
        self.controller = emulated_controller(MANIFEST, _MIRRORS, on_pulse=self._pulse, **made)
        self._stack = ExitStack()
        self.cameras: dict[Side, SimulatedGrasshopper] = {
            side: self._stack.enter_context(SimulatedGrasshopper(_address(index), f"2049721{index}"))
            for index, side in enumerate(SIDES)
        }
        quick = {"pacing_s": 0.002, "validate_first_s": 0.0, "image_load_us": 40_000.0, **settings}
        configuration = LightCrafterConfiguration.model_validate(quick)
        self.projector = LightCrafter(UsbTransport(backend=EmulatedUsb(self.controller)), manifest, configuration)
        left, right = (
            AravisCamera(f"{side} camera", GenicamConfiguration.model_validate({"address": self.cameras[side].address}))
            for side in SIDES
        )
        self.devices = RigDevices(left, right, self.projector)

    def __enter__(self) -> EmulatedRig:
        return self

    def __exit__(self, *_: object) -> None:
        for device in (*self.devices.cameras.values(), self.projector):
            device.close()
        self.controller.unplug()
        self._stack.close()

    def open(self) -> RigDevices:
        for device in (*self.devices.cameras.values(), self.projector):
            device.open()
        return self.devices

    def _pulse(self, exposure: Exposure) -> None:
        """In time on a busy machine as well."""
        if exposure.index == 0:
            self._started_s = time.monotonic()
        for side in self.wires:
            self.cameras[side].pulse(at_s=self._started_s + 1e-6 * exposure.at_us)


def _address(index: int) -> str:
    """On a part of the loopback network that no other test uses, and for this process alone."""
    process = os.getpid()
    return f"127.{1 + (process >> 14 & 0x1F)}.{process >> 7 & 0x7F}.{2 * (process & 0x7F) + index}"
