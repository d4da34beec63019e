"""What can go wrong with a device, named for its cause.

DriverError
├── DeviceNotFoundError       nothing answers under that serial, address or folder
├── DeviceUnavailableError    the driver's library is not installed here
├── DeviceBusyError           another program holds the device
├── DevicePermissionError     the operating system refuses access
├── DeviceLostError           it answered before and does not any more
├── DeviceStateError          a call that the device's state does not allow
├── DeviceConfigurationError  a setting was refused or did not read back
├── FrameTimeoutError         no frame came in time
├── IncompleteFrameError      a frame came damaged
├── SequenceInvalidError      the projector cannot show such a plan
└── ProtocolError             the device answered nonsense
"""

from __future__ import annotations

from models.errors import DuofringeError


class DriverError(DuofringeError):
    """A device failed. ``device`` is its role in the rig ("left camera"); ``index`` counts frames from 0."""

    def __init__(self, device: str, message: str, *, index: int | None = None) -> None:
        super().__init__(f"{device}: {message}")
        self.device = device
        self.index = index


class DeviceNotFoundError(DriverError):
    """Nothing answers under that serial number, address or folder."""


class DeviceUnavailableError(DriverError):
    """The library that the driver calls is not installed."""


class DeviceBusyError(DriverError):
    """Another program holds the device."""


class DevicePermissionError(DriverError):
    """The operating system refuses access to the device."""


class DeviceLostError(DriverError):
    """The device answered before and does not any more; close and open it again."""


class DeviceStateError(DriverError):
    """The call is not allowed in the device's state."""


class DeviceConfigurationError(DriverError):
    """A setting was refused, or reads back as something else.

    feature: the setting's name. wanted: what was asked. got: what the device holds or allows.
    """

    def __init__(self, device: str, feature: str, wanted: object, got: object) -> None:
        super().__init__(device, f"{feature} cannot be {wanted}; {got}")
        self.feature = feature
        self.wanted = wanted
        self.got = got


class FrameTimeoutError(DriverError):
    """No frame came in the time given."""


class IncompleteFrameError(DriverError):
    """A frame came damaged; its pixels are not used. status: the driver's word for what is wrong with it."""

    def __init__(self, device: str, status: str, *, index: int | None = None) -> None:
        super().__init__(device, f"a frame is incomplete ({status})", index=index)
        self.status = status


class SequenceInvalidError(DriverError):
    """The projector cannot show the plan as asked; nothing was projected."""


class ProtocolError(DriverError):
    """The device answered something that its protocol does not know."""
