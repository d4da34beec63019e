"""The devices of a virtual bench, reached as those of a real one are."""

from __future__ import annotations

from drivers.aravis import AravisCamera
from drivers.bench.bench import VirtualBench
from drivers.devices import RigDevices
from drivers.errors import DeviceUnavailableError
from drivers.genicam import GenicamConfiguration
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.usb import UsbTransport
from models.geometry.rig import SIDES, Rig, Side

NAME = "virtual bench"
PROJECTOR = LightCrafterConfiguration(validate_s=60.0)
"""The bench makes the images of a sequence while the controller is busy with validation."""


def bench_rig(seed: int, scene: int, calibration: Rig | None = None) -> RigDevices:
    """A rig on a bench of its own, which is taken down when the devices are let go of.

    Raises DeviceUnavailableError where its cameras cannot be put on the network.
    """
    try:
        bench = VirtualBench(seed, scene)
    except OSError as error:
        raise DeviceUnavailableError(NAME, f"its cameras find no place on the loopback network: {error}") from error
    return devices_of(bench, calibration)


def devices_of(
    bench: VirtualBench,
    calibration: Rig | None = None,
    *,
    manifest: FlashManifest | None = None,
    configuration: LightCrafterConfiguration = PROJECTOR,
) -> RigDevices:
    """Devices not yet opened: cameras over GigE Vision, the projector over USB. Released, they take the bench down.

    manifest: what the driver believes to be in flash, the truth where None. configuration: of the projector's driver.
    """
    left, right = (_camera(bench, side) for side in SIDES)
    transport = UsbTransport(timeout_s=configuration.timeout_s, backend=bench.usb)
    projector = LightCrafter(transport, manifest or bench.manifest, configuration)
    return RigDevices(left, right, projector, calibration, bench.source, release=bench.close)


def _camera(bench: VirtualBench, side: Side) -> AravisCamera:
    width, height = bench.source.camera_info(side).size
    reached = {"address": bench.addresses[side], "width": width, "height": height}
    return AravisCamera(f"{side} camera", GenicamConfiguration.model_validate(reached))
