"""What open cameras and projectors tell of themselves beyond their protocols."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.devices import RigDevices
from drivers.errors import DriverError
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.link import examine_camera
from drivers.lightcrafter.diagnosis import SUPPLY_LIMIT_A, ProjectorReport, examine_projector
from drivers.lightcrafter.projector import LightCrafter
from service.diagnosis.symptom import Symptom


def is_wired(devices: RigDevices) -> bool:
    """Whether pulses go from device to device, rather than by calls within this program."""
    return devices.stage is None or isinstance(devices.projector, LightCrafter)


def examine_hardware(devices: RigDevices) -> Iterator[Symptom]:
    """Of open devices; nothing of those that are no hardware."""
    for camera in devices.cameras.values():
        if isinstance(camera, GenicamCamera):
            yield from _camera(camera)
    if isinstance(devices.projector, LightCrafter):
        yield from _projector(devices.projector)


def _camera(camera: GenicamCamera) -> Iterator[Symptom]:
    subject = f"link of {camera.name}"
    try:
        link = examine_camera(camera)
    except DriverError as error:
        yield Symptom(subject, "fault", str(error), "check cable and power, then run this again")
        return
    speed = "" if link.bits_per_s is None else f" at {link.bits_per_s / 1e6:g} Mbit/s"
    text = f"{link.protocol}{speed}"
    if link.slow:
        yield Symptom(subject, "fault", text, "plug it into a faster port (USB3, gigabit), with a cable made for it")
    elif link.transmit_failures:
        lost = f"{text}; it could not send {link.transmit_failures} frames since it was switched on"
        yield Symptom(subject, "warning", lost, "give each camera a USB controller of its own, or a better cable")
    else:
        yield Symptom(subject, "ok", text)


def _projector(projector: LightCrafter) -> Iterator[Symptom]:
    try:
        report = examine_projector(projector)
    except DriverError as error:
        yield Symptom("projector status", "fault", str(error), "switch it off and on, then run this again")
        return
    yield Symptom("projector firmware", "ok", str(report.firmware))  # an older one than works is not opened
    if report.faults:
        yield Symptom("projector status", "warning", report.faults, "switch it off and on; look at lamp and DMD cable")
    else:
        yield Symptom("projector status", "ok", f"initialised, no error, at {report.location}")
    yield _leds(report)
    yield _flash(report)


def _leds(report: ProjectorReport) -> Symptom:
    drive = ", ".join(f"{value} of {limit}" for value, limit in zip(report.drive, report.limits, strict=True))
    text = f"red, green, blue at {drive}; the board draws about {report.supply_a:.1f} A"
    if report.over_limit:
        remedy = "close other programs, connect again; look at rig.projector.led_inverted and led_polarity"
        return Symptom("projector LEDs", "fault", f"{text}: {' and '.join(report.over_limit)} beyond the limit", remedy)
    if report.supply_a > SUPPLY_LIMIT_A:
        remedy = f"lower rig.projector.led_limits until it draws less than {SUPPLY_LIMIT_A} A"
        return Symptom("projector LEDs", "warning", text, remedy)
    return Symptom("projector LEDs", "ok", text)


def _flash(report: ProjectorReport) -> Symptom:
    """More images than the manifest counts on do no harm."""
    subject = "projector flash"
    text = f"{report.flash_images} images, the manifest needs {report.needed_images}"
    if report.flash_images < report.needed_images:
        remedy = "write the firmware that belongs to the manifest, or name the manifest that belongs to the firmware"
        return Symptom(subject, "fault", text, remedy)
    return Symptom(subject, "ok", text)
