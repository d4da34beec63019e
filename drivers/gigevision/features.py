"""The features of the simulated camera: one table, from which come its registers, its limits and its XML.

Names and rules are those of a GS3-U3-23S6M; where it is switched on, every automatic function runs, as there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["integer", "float", "enumeration", "boolean", "command"]
Access = Literal["RW", "RO", "WO"]
SENSOR_SIZE = (1920, 1200)
SHORTEST_US, LONGEST_US = 16.0, 351_828.0
MOST_GAIN_DB = 29.9


@dataclass(frozen=True)
class Condition:
    """Whether a feature has a value (an entry's number for enumerations), or has not."""

    feature: str
    value: int
    equal: bool = True

    def holds(self, values: dict[str, float]) -> bool:
        return (values[self.feature] == self.value) is self.equal


@dataclass(frozen=True)
class Feature:
    """One feature. Its default is an entry's index for enumerations.

    less: a feature whose value comes off the maximum. step: values are refused (integers) or rounded (floats) to it.
    locked: conditions under any of which it cannot be written. available: under which alone it is there.
    """

    name: str
    kind: Kind
    default: float = 0
    minimum: float = 0
    maximum: float = 0xFFFF_FFFF
    step: float = 1
    less: str | None = None
    unit: str = ""
    entries: tuple[str, ...] = ()
    access: Access = "RW"
    locked: tuple[Condition, ...] = ()
    available: Condition | None = None

    @property
    def size(self) -> int:
        """Bytes of its register."""
        return 8 if self.kind == "float" else 4


_STREAMING = Condition("TLParamsLocked", 0, equal=False)
_TRIGGERED = Condition("TriggerMode", 1)
_FREE = Condition("TriggerMode", 0)
_LINES = ("Line0", "Line1", "Line2", "Line3")


def _choice(name: str, *entries: str, default: int = 0, **more: object) -> Feature:
    return Feature(name, "enumeration", default, entries=entries, **more)  # type: ignore[arg-type]


def _auto(name: str) -> Feature:
    return _choice(name, "Off", "Once", "Continuous", default=2)


def _flag(name: str, default: bool) -> Feature:
    return Feature(name, "boolean", int(default), maximum=1)


def _status(name: str, default: float = 0) -> Feature:
    return Feature(name, "integer", default, access="RO")


FEATURES: tuple[Feature, ...] = (
    # image
    Feature("Width", "integer", 1920, 32, SENSOR_SIZE[0], 32, "OffsetX", "px", locked=(_STREAMING,)),
    Feature("Height", "integer", 1200, 2, SENSOR_SIZE[1], 2, "OffsetY", "px", locked=(_STREAMING,)),
    Feature("OffsetX", "integer", 0, 0, SENSOR_SIZE[0], 4, "Width", "px"),
    Feature("OffsetY", "integer", 0, 0, SENSOR_SIZE[1], 2, "Height", "px"),
    _status("WidthMax", SENSOR_SIZE[0]),
    _status("HeightMax", SENSOR_SIZE[1]),
    _status("SensorWidth", SENSOR_SIZE[0]),
    _status("SensorHeight", SENSOR_SIZE[1]),
    _choice("PixelFormat", "Mono8", "Mono16", locked=(_STREAMING,)),
    _status("PayloadSize"),
    _choice("VideoMode", "Mode0", "Mode1", "Mode7", locked=(_STREAMING,)),
    Feature("BinningVertical", "integer", 1, 1, 1, locked=(_STREAMING,)),
    Feature("ReverseX", "boolean", 0, maximum=1, locked=(_STREAMING,)),
    _choice("TestPattern", "Off", "Ramp"),
    # acquisition and trigger
    _choice("AcquisitionMode", "Continuous", "SingleFrame", "MultiFrame"),
    Feature("AcquisitionStart", "command", access="WO"),
    Feature("AcquisitionStop", "command", access="WO"),
    Feature("TLParamsLocked", "integer", 0, maximum=1),
    _choice("TriggerSelector", "FrameStart", "ExposureActive"),
    _choice("TriggerMode", "Off", "On"),
    _choice("TriggerSource", "Software", *_LINES, default=1),
    _choice("TriggerActivation", "RisingEdge", "FallingEdge", default=1),
    _choice("TriggerOverlap", "Off", "ReadOut", available=_TRIGGERED),
    _flag("TriggerDelayEnabled", False),
    Feature("TriggerDelay", "float", 0, 0, 65_520, 1, unit="us"),
    Feature("TriggerSoftware", "command", access="WO"),
    _choice("AcquisitionStatusSelector", "AcquisitionTriggerWait", "FrameTriggerWait", default=1),
    Feature("AcquisitionStatus", "boolean", 0, maximum=1, access="RO"),
    # exposure and rate
    _choice("ExposureMode", "Timed", "TriggerWidth"),
    _auto("ExposureAuto"),
    Feature(
        "ExposureTime",
        "float",
        10_000,
        SHORTEST_US,
        LONGEST_US,
        0.5,
        unit="us",
        locked=(Condition("ExposureAuto", 0, equal=False), Condition("ExposureMode", 1)),
    ),
    _auto("pgrExposureCompensationAuto"),
    _choice("AcquisitionFrameRateAuto", "Off", "Continuous", default=1, available=_FREE),
    Feature("AcquisitionFrameRateEnabled", "boolean", 1, maximum=1, available=_FREE),
    Feature(
        "AcquisitionFrameRate",
        "float",
        60,
        1,
        162,
        0.01,
        unit="Hz",
        locked=(Condition("AcquisitionFrameRateAuto", 0, equal=False),),
        available=_FREE,
    ),
    # analog
    _auto("GainAuto"),
    _choice("GainSelector", "All"),
    Feature("Gain", "float", 0, 0, MOST_GAIN_DB, 0.01, unit="dB", locked=(Condition("GainAuto", 0, equal=False),)),
    Feature("BlackLevel", "float", 0, 0, 10, 0.01, unit="%"),
    _flag("GammaEnabled", True),
    Feature("Gamma", "float", 1.25, 0.5, 4, 0.01),
    _auto("SharpnessAuto"),
    _flag("SharpnessEnabled", True),
    _flag("LUTEnable", False),
    _flag("pgrHDRModeEnabled", False),
    _flag("pgrDefectPixelCorrectionEnable", True),
    # lines
    _choice("LineSelector", *_LINES),
    _choice("LineMode", "Input", "Output"),
    Feature("LineDebouncerTimeRaw", "integer", 0, 0, 4095, unit="us"),
    # status
    _status("TransmitFailureCount"),
    _status("TimestampIncrement", 1),
    Feature("DeviceTemperature", "float", 41.5, -100, 200, access="RO", unit="C"),
    Feature("DeviceLinkThroughputLimit", "integer", 350_600_000, 1_000_000, 384_400_000),
)
