"""The bench put together."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from drivers.bench.controller import FaultyController
from drivers.bench.sight import Sight
from drivers.bench.wiring import Wiring
from drivers.gigevision import SimulatedGrasshopper, TriggerFaults
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.emulator.i2c_device import EmulatedUsbIss, I2cSlave
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.emulator.serial_port import EmulatedSerialPort
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.simulator.devices import SimulatedSource
from drivers.virtual.faults import Faults, PlantedFault
from models.geometry.rig import SIDES, Side
from models.patterns import make_plan

SERIALS: dict[Side, str] = {"left": "20497219", "right": "20497220"}


class VirtualBench:
    """Emulated devices before one of the simulated scenes, from construction to ``close``; also a context manager.

    seed, scene: as of the simulated rig. source: another one in their place. manifest: what the emulated flash holds,
    the patterns of the plan "full" where None. addresses: of the cameras, 127.x.y.z; OSError where one is taken.
    """

    def __init__(
        self,
        seed: int = 0,
        scene: int = 0,
        *,
        source: SimulatedSource | None = None,
        manifest: FlashManifest | None = None,
        addresses: dict[Side, str] | None = None,
    ) -> None:
        self.source = source or SimulatedSource(seed, scene)
        self.manifest = manifest or FlashManifest.packed(make_plan("full"))
        self.addresses = addresses or own_addresses()
        self.faults = Faults()
        flash = EmulatedFlash([self.manifest.render(index) for index in range(self.manifest.images)])
        self.projector = FaultyController(
            flash,
            self.faults,
            on_pulse=self._on_pulse,
            on_valid=self._on_valid,
        )
        self.cameras: dict[Side, SimulatedGrasshopper] = {}
        self.sight = Sight(self.source, self.projector, self.cameras, LightCrafterConfiguration().led_limits)
        self.wiring = Wiring(self.cameras, self.sight, self.faults)
        self.usb = EmulatedUsb(self.projector)
        self._ports: list[EmulatedSerialPort] = []
        try:
            for side in SIDES:
                self.cameras[side] = SimulatedGrasshopper(
                    self.addresses[side],
                    SERIALS[side],
                    self.sight.now(side),
                    partial(self.wiring.on_start, side),
                )
        except OSError:
            self.close()
            raise

    def __enter__(self) -> VirtualBench:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def plant(self, fault: PlantedFault) -> None:
        """Have a fault from the next sequence on."""
        self.faults.plant(fault)

    def mend(self) -> None:
        """Undo everything that was made to go wrong; whatever is unplugged is plugged in, as after switching on."""
        self.faults.clear()
        self.wiring.inverted.clear()
        self.wiring.cut.clear()
        self.projector.mend()
        self.plug_projector()
        for camera in self.cameras.values():
            camera.plan_faults(TriggerFaults())
            if camera.unplugged:
                camera.plug()

    def unplug_projector(self) -> None:
        """No power, on whatever port it is."""
        self.projector.unplug()

    def plug_projector(self) -> None:
        """Power again, if there was none."""
        if not self.projector.plugged:
            self.projector.plug()

    def open_serial_port(self, path: Path) -> EmulatedSerialPort:
        """A USB-ISS at ``path`` that leads to the projector's I2C, until the bench is closed."""
        port = EmulatedSerialPort(EmulatedUsbIss(I2cSlave(self.projector)), path)
        self._ports.append(port)
        return port

    def _on_pulse(self, exposure: Exposure) -> None:
        self.wiring.on_pulse(exposure)

    def _on_valid(self, exposures: tuple[Exposure, ...]) -> None:
        self.wiring.on_valid(exposures)

    def close(self) -> None:
        """Take everything off the bench. Idempotent."""
        self.wiring.close()
        self.projector.unplug()
        for port in self._ports:
            port.unplug()
        for camera in self.cameras.values():
            camera.close()


def own_addresses() -> dict[Side, str]:
    """Loopback addresses that belong to this process, so that several benches do not meet."""
    number = os.getpid()
    high, middle, low = number >> 14 & 0x3F | 0x40, number >> 7 & 0x7F, 2 * (number & 0x7F)
    return {side: f"127.{high}.{middle | 0x80}.{low + index}" for index, side in enumerate(SIDES)}
