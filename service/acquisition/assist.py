"""The exposure assistant: settings that fill the range of both cameras without saturating."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.camera import Camera, CameraSettings, SoftwareTriggered, Trigger
from drivers.devices import RigDevices
from drivers.errors import FrameTimeoutError, IncompleteFrameError
from drivers.projector import ProjectorSettings
from models.capture import Image
from models.geometry.rig import Side
from models.patterns import Pattern, make_pattern
from service.acquisition.cancellation import Cancellation
from service.acquisition.recorded import RigSettings
from service.acquisition.request import AssistRequest

_ROUNDS = 8
_LIT_SHARE_OF_RANGE = 0.02
"""More light than this under white than under black makes a pixel lit."""
_FEWEST_LIT = 0.002
_BRIGHTEST = 99.0
"""Percentile of the lit pixels that is brought to the target: a few glints may saturate."""
_TOLERANCE = 0.06
_WHITE, _BLACK = make_pattern("white"), make_pattern("black")


@dataclass(frozen=True)
class Reading:
    """What one camera sees under white, as shares of full scale. lit: share of the pixels that light reaches."""

    brightest: float
    lit: float
    saturated: float


@dataclass(frozen=True)
class Assistance:
    """Settings found. reached: both cameras' brightest pixels are at the target. reason: why not, in words."""

    settings: RigSettings
    readings: Mapping[Side, Reading]
    reached: bool
    reason: str = ""


def find_exposure(
    devices: RigDevices, start: RigSettings, request: AssistRequest, cancellation: Cancellation
) -> Assistance:
    """Search exposure, brightness and gain under a held white pattern; it ends with cameras disarmed, projector dark.

    Exposure is common to both cameras, because a pattern is lit once for both: it fits the brighter view; the gain
    lifts the darker. Where the shortest exposure of an 8-bit pattern is still too bright, the projector is dimmed.
    Raises DriverError, CaptureCancelledError.
    """
    search = _Search(devices, request)
    settings = start
    previous: tuple[RigSettings, Mapping[Side, Reading]] | None = None
    try:
        for _ in range(_ROUNDS):
            cancellation.raise_if_requested()
            readings = search.read(settings)
            if any(reading.lit < _FEWEST_LIT for reading in readings.values()):
                brighter = search.brightest(settings)
                if brighter == settings:
                    reason = "the projector's light is not seen; check lamp, lens cap, focus and aim"
                    return Assistance(settings, readings, False, reason)
                settings = brighter
                continue
            if all(abs(r.brightest - request.target) <= _TOLERANCE for r in readings.values()):
                return Assistance(settings, readings, True)
            if previous is not None and _no_response(previous, (settings, readings)):
                reason = "the images do not follow the exposure; a replayed rig shows what was recorded"
                return Assistance(start, readings, False, reason)
            previous = (settings, readings)
            following = search.better(settings, readings)
            if following == settings:
                return Assistance(settings, readings, False, _limit_reason(readings, request))
            settings = following
        return Assistance(settings, search.read(settings), False, "no steady reading; does something move or flicker?")
    finally:
        devices.projector.stop()
        for camera in devices.cameras.values():
            camera.disarm()


class _Search:
    def __init__(self, devices: RigDevices, request: AssistRequest) -> None:
        self._devices = devices
        self._request = request
        cameras = [camera.info.limits for camera in devices.cameras.values()]
        shortest = devices.projector.info.limits.exposure_us[0]
        self._exposures = (
            max(shortest, *(limits.exposure_us[0] for limits in cameras)),
            max(shortest, min(request.longest_exposure_us, *(limits.exposure_us[1] for limits in cameras))),
        )

    def read(self, settings: RigSettings) -> dict[Side, Reading]:
        """Readings of both cameras under white and black."""
        self._devices.projector.configure(settings.projector)
        images: dict[Side, list[Image]] = {}
        white_levels: dict[Side, int] = {}
        for side, camera in self._devices.cameras.items():
            white_levels[side] = camera.configure(settings.cameras[side]).white_level
        for pattern in (_WHITE, _BLACK):
            self._show(pattern)
            for side, camera in self._devices.cameras.items():
                images.setdefault(side, []).append(_one_image(camera))
        return {side: _reading(lit, dark, white_levels[side]) for side, (lit, dark) in images.items()}

    def _show(self, pattern: Pattern) -> None:
        """The projector's own white or black, with the parameters that it stores."""
        stored = self._devices.projector.info.stored
        known = None if stored is None else next((p for p in stored.patterns if p.kind == pattern.kind), None)
        if stored is None:
            self._devices.projector.show(pattern)
        elif known is not None:
            self._devices.projector.show(known)
        else:
            lit = next((p for p in stored.patterns if p.kind == "composite"), stored.patterns[0])
            self._devices.projector.show(lit if pattern.kind == "white" else None)

    def brightest(self, settings: RigSettings) -> RigSettings:
        """Full lamp and longest exposure, for a scene in which nothing is seen yet."""
        cameras = {
            side: s.model_copy(update={"exposure_us": self._exposures[1]}) for side, s in settings.cameras.items()
        }
        return RigSettings(cameras, ProjectorSettings(brightness=1.0))

    def better(self, settings: RigSettings, readings: Mapping[Side, Reading]) -> RigSettings:
        """One step: the exposure for the brighter view, lamp where the exposure ends, then gain for the darker."""
        target = self._request.target
        factors = {side: _factor(reading, target) for side, reading in readings.items()}
        exposure = max(camera.exposure_us for camera in settings.cameras.values())
        # gains that an earlier round raised come back first
        gains = {side: camera.gain_db for side, camera in settings.cameras.items()}
        without_gain = {side: factors[side] * 10 ** (gains[side] / 20) for side in factors}
        common = min(without_gain.values())
        light = exposure * settings.projector.brightness * common
        new_exposure = float(np.clip(round(light), *self._exposures))
        brightness = float(np.clip(round(light / new_exposure, 3), 0.01, 1.0))
        gained = new_exposure * brightness / (exposure * settings.projector.brightness)
        cameras: dict[Side, CameraSettings] = {}
        for side, camera in settings.cameras.items():
            limits = self._devices.cameras[side].info.limits.gain_db
            wanted = 20 * float(np.log10(max(without_gain[side] / gained, 1e-3)))
            gain = round(float(np.clip(wanted, limits[0], min(limits[1], self._request.largest_gain_db))), 1)
            cameras[side] = camera.model_copy(update={"exposure_us": new_exposure, "gain_db": gain})
        return replace(settings, cameras=cameras, projector=ProjectorSettings(brightness=brightness))


def _one_image(camera: Camera) -> Image:
    """One image of what is shown now, asked for once more where it does not come whole."""
    try:
        return _image(camera)
    except (FrameTimeoutError, IncompleteFrameError):
        return _image(camera)


def _image(camera: Camera) -> Image:
    """The first free-running frame may have begun before what is shown now, so it is not used."""
    software = isinstance(camera, SoftwareTriggered)
    camera.arm(1 if software else None, Trigger.SOFTWARE if software else Trigger.FREE_RUN)
    try:
        if isinstance(camera, SoftwareTriggered):
            camera.software_trigger()
        else:
            camera.wait_frame(2.0)
        return camera.wait_frame(2.0).image
    finally:
        camera.disarm()


def _reading(white: Image, black: Image, white_level: int) -> Reading:
    """Readings inside the lit pixels."""
    lit = white.astype(np.float32) - black > _LIT_SHARE_OF_RANGE * white_level
    share = float(lit.mean())
    if share == 0:
        return Reading(0.0, 0.0, 0.0)
    values = white[lit]
    brightest = float(np.percentile(values, _BRIGHTEST)) / white_level
    return Reading(round(brightest, 4), round(share, 4), round(float((values >= white_level).mean()), 4))


def _factor(reading: Reading, target: float) -> float:
    """How much more light the view wants; a clipped reading tells only that it is far less."""
    return 0.4 if reading.brightest >= 0.995 else target / max(reading.brightest, 0.01)


def _no_response(
    previous: tuple[RigSettings, Mapping[Side, Reading]], now: tuple[RigSettings, Mapping[Side, Reading]]
) -> bool:
    """Whether the light changed by a third or more and no reading moved at all."""

    def light(settings: RigSettings, side: Side) -> float:
        camera = settings.cameras[side]
        return camera.exposure_us * settings.projector.brightness * float(10 ** (camera.gain_db / 20))

    changes = [abs(np.log(light(now[0], side) / light(previous[0], side))) for side in now[1]]
    pairs = [(now[1][side], previous[1][side]) for side in now[1]]
    moved = [max(abs(a.brightest - b.brightest), abs(a.saturated - b.saturated)) for a, b in pairs]
    return max(changes) > np.log(4 / 3) and max(moved) < 0.001


def _limit_reason(readings: Mapping[Side, Reading], request: AssistRequest) -> str:
    if any(reading.brightest > request.target for reading in readings.values()):
        return "too bright even at the shortest exposure and the dimmest lamp; close the lenses' iris"
    return "too dark even at the longest exposure and gain allowed; open the iris, come nearer or allow more gain"
