"""What a camera is set to, in the only order that works.

A Grasshopper3 locks features while others hold certain values, and is shipped with every automatic function running,
which would bend the fringes. Names are those of its feature list; cameras that lack an optional one are taken as well.
"""

from __future__ import annotations

import time
from contextlib import suppress

from drivers.camera import AppliedSettings, BitDepth, CameraLimits, CameraSettings, Trigger
from drivers.errors import DeviceConfigurationError
from drivers.genicam.configuration import GenicamConfiguration
from drivers.genicam.features import Features, Value

PIXEL_FORMATS: dict[BitDepth, str] = {8: "Mono8", 12: "Mono16"}
"""Of Mono16, a Grasshopper3 fills the upper 12 bits."""
_ROUNDING = 1e-6
_READY_S = 1.0
_STRAIGHT: tuple[tuple[str, Value], ...] = (
    ("ExposureAuto", "Off"),
    ("pgrExposureCompensationAuto", "Off"),
    ("GainAuto", "Off"),
    ("SharpnessAuto", "Off"),
    ("BalanceWhiteAuto", "Off"),
    ("BlackLevelAuto", "Off"),
    ("GammaEnabled", False),
    ("GammaEnable", False),
    ("SharpnessEnabled", False),
    ("LUTEnable", False),
    ("pgrHDRModeEnabled", False),
    ("TestPattern", "Off"),
)
"""Whatever changes grey values behind our back, and what it must be."""
_RECORDED: tuple[tuple[str, type[Value]], ...] = (
    ("OffsetX", int),
    ("OffsetY", int),
    ("VideoMode", str),
    ("ReverseX", bool),
    ("ExposureMode", str),
    ("BlackLevel", float),
    ("Gamma", float),
    ("TriggerSelector", str),
    ("TriggerActivation", str),
    ("TriggerDelayEnabled", bool),
    ("pgrDefectPixelCorrectionEnable", bool),
    ("DeviceLinkThroughputLimit", int),
    ("TimestampIncrement", int),
)


def prepare(features: Features, configuration: GenicamConfiguration, device: str, bit_depth: BitDepth = 8) -> None:
    """Everything but exposure, gain and the trigger; acquisition stands still.

    Raises DeviceConfigurationError for a feature that is needed and cannot be had, and for one that would bend grey
    values and cannot be switched off.
    """
    features.write("TriggerSelector", "FrameStart")
    features.write("TriggerMode", "Off")
    _if_there(features, "AcquisitionMode", "Continuous")
    _set_region(features, configuration)
    if not features.offers("PixelFormat", PIXEL_FORMATS[bit_depth]):
        raise DeviceConfigurationError(device, "bit_depth", bit_depth, f"the camera has no {PIXEL_FORMATS[bit_depth]}")
    features.write("PixelFormat", PIXEL_FORMATS[bit_depth])
    if not configuration.processing:
        straighten(features)
    _if_there(features, "ReverseX", configuration.reverse_x)
    _if_there(features, "ExposureMode", "Timed")
    if configuration.black_level is not None:
        features.write("BlackLevel", configuration.black_level)
    _limit_rate(features, False)
    _if_there(features, "LineSelector", configuration.trigger_line)
    _if_there(features, "LineMode", "Input")
    if configuration.debounce_us is not None:
        features.write("LineDebouncerTimeRaw", configuration.debounce_us)
    if configuration.link_limit is not None:
        features.write("DeviceLinkThroughputLimit", configuration.link_limit)


def straighten(features: Features) -> None:
    """Switch off whatever is there that bends grey values."""
    for name, value in _STRAIGHT:
        _if_there(features, name, value)
    if not features.has("GammaEnabled") and not features.has("GammaEnable"):
        _if_there(features, "Gamma", 1.0)


def require_straight(features: Features, device: str) -> None:
    """DeviceConfigurationError for the first automatic function or curve that is on again."""
    for name, value in _STRAIGHT:
        known = features.offers(name, value) if isinstance(value, str) else features.has(name)
        if known and (held := features.read(name, type(value))) != value:
            raise DeviceConfigurationError(
                device, name, value, f"the camera has switched it to {held}; configure again"
            )


def set_exposure(features: Features, settings: CameraSettings) -> None:
    features.write("ExposureTime", settings.exposure_us)
    features.write("Gain", settings.gain_db)


def set_trigger(features: Features, configuration: GenicamConfiguration, trigger: Trigger) -> None:
    """Source and edge are chosen while the trigger is off; overlapping exists only while it is on."""
    features.write("TriggerSelector", "FrameStart")
    features.write("TriggerMode", "Off")
    if trigger is Trigger.FREE_RUN:
        _run_freely(features, configuration.live_rate_hz)
        return
    _limit_rate(features, False)
    source = "Software" if trigger is Trigger.SOFTWARE else configuration.trigger_line
    features.write("TriggerSource", source)
    features.write("TriggerActivation", configuration.trigger_activation)
    _if_there(features, "TriggerDelayEnabled", False)
    features.write("TriggerMode", "On")
    _if_there(features, "TriggerOverlap", configuration.trigger_overlap)


def await_readiness(features: Features, exposure_us: float, configuration: GenicamConfiguration) -> None:
    """Until the camera says that it waits for a trigger; one that cannot, or is not believed, gets time."""
    if configuration.ready_by == "status" and _tells_readiness(features):
        features.write("AcquisitionStatusSelector", "FrameTriggerWait")
        deadline = time.monotonic() + _READY_S + 2e-6 * exposure_us
        while time.monotonic() < deadline:
            if features.read("AcquisitionStatus", bool):
                return
            time.sleep(0.001)
    time.sleep(configuration.settle_s)


def _tells_readiness(features: Features) -> bool:
    return features.offers("AcquisitionStatusSelector", "FrameTriggerWait") and features.has("AcquisitionStatus")


def read_limits(features: Features) -> CameraLimits:
    """Of exposure and gain, with automatic functions off and the trigger on."""
    depths: tuple[BitDepth, ...] = tuple(
        depth for depth, name in PIXEL_FORMATS.items() if features.offers("PixelFormat", name)
    )
    return CameraLimits(features.float_range("ExposureTime"), features.float_range("Gain"), depths)


def check_limits(limits: CameraLimits, settings: CameraSettings, device: str) -> None:
    """DeviceConfigurationError for the first setting that lies outside."""
    for feature, unit, wanted, (low, high) in (
        ("exposure_us", "us", settings.exposure_us, limits.exposure_us),
        ("gain_db", "dB", settings.gain_db, limits.gain_db),
    ):
        if not low - _ROUNDING * abs(low) <= wanted <= high + _ROUNDING * abs(high):
            raise DeviceConfigurationError(device, feature, wanted, f"it takes {low:g} to {high:g} {unit}")
    if settings.bit_depth not in limits.bit_depths:
        known = " or ".join(map(str, limits.bit_depths))
        raise DeviceConfigurationError(device, "bit_depth", settings.bit_depth, f"it delivers {known} bits")


def read_applied(features: Features) -> AppliedSettings:
    """What the camera holds; features that change with the kind of trigger are left out."""
    depth = 8 if features.read("PixelFormat", str) == PIXEL_FORMATS[8] else 12
    recorded = (*((name, type(value)) for name, value in _STRAIGHT), *_RECORDED)
    held: dict[str, Value] = {name: features.read(name, kind) for name, kind in recorded if features.has(name)}
    return AppliedSettings(
        exposure_us=features.read("ExposureTime", float),
        gain_db=features.read("Gain", float),
        bit_depth=depth,
        white_level=2**depth - 1,
        size=(features.read("Width", int), features.read("Height", int)),
        features=held,
    )


def _set_region(features: Features, configuration: GenicamConfiguration) -> None:
    """Offsets first to zero, else they bound the size."""
    for axis, extent in (("X", "Width"), ("Y", "Height")):
        asked = configuration.width if axis == "X" else configuration.height
        offset = configuration.offset_x if axis == "X" else configuration.offset_y
        features.write(f"Offset{axis}", 0)
        features.write(extent, features.snap(extent, asked))
        room = features.integer_range(f"Offset{axis}")[1]
        features.write(f"Offset{axis}", features.snap(f"Offset{axis}", room // 2 if offset is None else offset))


def _run_freely(features: Features, rate_hz: float) -> None:
    _limit_rate(features, True)
    if features.has("AcquisitionFrameRate"):
        low, high = features.float_range("AcquisitionFrameRate")
        with suppress(DeviceConfigurationError):
            features.write("AcquisitionFrameRate", min(max(rate_hz, low), high))


def _limit_rate(features: Features, limited: bool) -> None:
    """Cameras lock these against one another in different ways, and none matters to a triggered frame."""
    names = ("AcquisitionFrameRateEnabled", "AcquisitionFrameRateEnable")
    steps: list[tuple[str, Value]] = [("AcquisitionFrameRateAuto", "Off"), *((name, limited) for name in names)]
    for name, value in (*steps, *steps[:1]):
        with suppress(DeviceConfigurationError):
            _if_there(features, name, value)


def _if_there(features: Features, name: str, value: Value) -> None:
    """Write what the camera has now; an entry that it does not know is no use either."""
    known = features.offers(name, value) if isinstance(value, str) else features.has(name)
    if known:
        features.write(name, value)
