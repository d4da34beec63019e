"""Settings for what nobody has measured yet: registers that are left alone until somebody names a value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from lightcrafter_benches import MANIFEST, Made, controller, quick, usb_transport
from pydantic import ValidationError

from drivers.errors import DeviceConfigurationError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.usb import UsbTransport

BOARD = {c.FLIP_LONG.usb, c.FLIP_SHORT.usb, c.TRIGGER_OUTPUT.usb}


class Listening:
    """A transport to an emulated controller that keeps what is written to the board's registers."""

    def __init__(self, inner: UsbTransport, *, deaf_flips: bool = False) -> None:
        self._inner = inner
        self._deaf_flips = deaf_flips
        self.largest_payload = inner.largest_payload
        self.written: list[tuple[str, int, bytes]] = []

    @property
    def location(self) -> str:
        return self._inner.location

    def carries(self, command: Command[Any]) -> bool:
        return self._inner.carries(command)

    def open(self) -> None:
        self._inner.open()

    def close(self) -> None:
        self._inner.close()

    def request(self, command: Command[Any], payload: bytes | None = None) -> bytes:
        if payload is None or command.usb not in BOARD:
            return self._inner.request(command, payload)
        self.written.append((command.name, command.usb, payload))
        if self._deaf_flips:
            return b""
        return self._inner.request(command, payload)


def opened(*, deaf_flips: bool = False, **settings: Any) -> list[tuple[str, int, bytes]]:
    """What opening a projector under these settings writes to the registers of its board."""
    transport = Listening(usb_transport(controller())[0], deaf_flips=deaf_flips)
    projector = LightCrafter(transport, MANIFEST, quick(**settings))
    try:
        projector.open()
    finally:
        projector.close()
    return transport.written


def test_what_is_not_confirmed_is_left_alone() -> None:
    assert opened() == []


@pytest.mark.parametrize(
    ("settings", "payload"),
    [
        ({"trigger_out_polarity": 0}, b"\x00\xbb\xbb"),
        ({"trigger_out_polarity": 1}, b"\x01\xbb\xbb"),
        ({"trigger_out_polarity": 2}, b"\x02\xbb\xbb"),
        ({"trigger_out_delays_us": (-20.05, 0.0)}, b"\x00\x00\xbb"),
        ({"trigger_out_polarity": 2, "trigger_out_delays_us": (-1.072, 2.787)}, b"\x02\xb1\xd5"),
    ],
)
def test_the_trigger_output_is_written_once_it_is_named(settings: dict[str, Any], payload: bytes) -> None:
    """Delays: 0x00 is -20.05 us, 0xBB none, 0xD5 +2.787 us."""
    assert opened(**settings) == [("trigger output 1", 0x1A1D, payload)]


def test_flips_are_written_and_read_back() -> None:
    assert [payload for _, _, payload in opened(flip_short=True)] == [b"\x01"]
    assert [payload for _, _, payload in opened(flip_long=False, flip_short=True)] == [b"\x00", b"\x01"]
    with pytest.raises(DeviceConfigurationError, match="flip of the long axis cannot be 1; it reads back as 0"):
        opened(flip_long=True, deaf_flips=True)


def test_a_named_flip_survives_what_another_program_left(make: Callable[..., Made]) -> None:
    projector, device = make(flip_long=False)
    device.handle(c.FLIP_LONG.usb, b"\x01")
    projector.open()
    assert device.handle(c.FLIP_LONG.usb, None) == b"\x00"


@pytest.mark.parametrize("delays", [(-20.2, 0.0), (0.0, 2.9), (0.0, float("nan"))])
def test_delays_beyond_the_register_are_refused(delays: tuple[float, float]) -> None:
    with pytest.raises(ValidationError, match=r"trigger_out_delays_us are -20\.05\.\.2\.787"):
        quick(trigger_out_delays_us=delays)


@pytest.mark.parametrize("polarity", [3, -1])
def test_other_polarities_are_refused(polarity: int) -> None:
    with pytest.raises(ValidationError, match="trigger_out_polarity"):
        quick(trigger_out_polarity=polarity)
