"""The devices of a virtual bench, reached as those of a real one are."""

from __future__ import annotations

from drivers.aravis.camera import AravisCamera
from drivers.aravis.configuration import AravisConfiguration
from drivers.bench.bench import VirtualBench
from drivers.devices import RigDevices
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import UsbTransport
from models.geometry.rig import Rig

_VALIDATION_S = 60.0
"""The bench makes the images of a sequence while the controller is busy with validation."""


def bench_rig(seed: int, scene: int, calibration: Rig | None = None) -> RigDevices:
    """A rig on a bench of its own, which goes when the devices are let go of.

    Raises DeviceUnavailableError where the bench cannot be set up.
    """
    bench = VirtualBench(seed, scene)
    return devices_of(bench, calibration)


def devices_of(bench: VirtualBench, calibration: Rig | None = None, *, validate_s: float = _VALIDATION_S) -> RigDevices:
    """Devices not yet opened: cameras over GigE Vision, the projector over USB. They let go of the bench when released.

    validate_s: patience with the controller's validation.
    """
    left, right = (
        AravisCamera(f"{side} camera", AravisConfiguration.model_validate({"address": bench.addresses[side]}))
        for side in bench.addresses
    )
    configuration = LightCrafterConfiguration(validate_s=validate_s)
    projector = LightCrafter(UsbTransport(backend=bench.usb), bench.manifest, configuration)
    return RigDevices(left, right, projector, calibration, bench.source, release=bench.close)
