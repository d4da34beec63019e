"""Whichever single command is refused, the projector can be made dark, and what it shows next has all its light."""

from __future__ import annotations

import itertools
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
from lightcrafter_benches import MANIFEST, quick

from drivers.errors import DriverError, ProtocolError
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.usb import UsbTransport
from drivers.projector import ProjectorSettings, ProjectorState
from models.patterns import PatternPlan

FLASH = EmulatedFlash([MANIFEST.render(index) for index in range(MANIFEST.images)])
PATTERN = next(stored.pattern for stored in MANIFEST.patterns if stored.depth == 8)
LIT = PATTERN.model_copy(update={"exposure_us": 8333.0})


class OnceRefusing(EmulatedController):
    """Refuses the command that comes ``refuse_in`` commands from now, and no other."""

    refuse_in: int | None = None

    def handle(self, code: int, payload: bytes | None, argument: bytes = b"") -> bytes:
        if self.refuse_in is not None:
            self.refuse_in -= 1
            if self.refuse_in < 0:
                self.refuse_in = None
                raise RefusedError
        return super().handle(code, payload, argument)


@pytest.mark.parametrize("hold", ["sequence", "video"])
def test_dark_after_stop_whatever_was_refused(hold: str) -> None:
    device = OnceRefusing(FLASH, validation_s=0.0)
    projector = LightCrafter(UsbTransport(backend=EmulatedUsb(device)), MANIFEST, quick(hold=hold, settle_s=0.3))
    projector.open()
    full = device.led_shares()
    for refused in itertools.count():
        device.refuse_in = refused
        with suppress(DriverError):
            projector.show(LIT)
        with suppress(DriverError):
            projector.show(None)
        projector.stop()
        everything_came = device.refuse_in is not None
        device.refuse_in = None
        assert projector.state is not ProjectorState.HOLDING
        assert not device.running, f"still running where command {refused} was refused"
        assert not device.light().any(), f"still lit where command {refused} was refused"
        projector.load(PatternPlan(patterns=(LIT,)), 9000)
        assert device.led_shares() == full, f"other light where command {refused} was refused"
        projector.configure(ProjectorSettings())
        if everything_came:
            break
    assert refused > 10
    projector.close()


def test_dark_after_stop_whatever_was_refused_of_a_sequence() -> None:
    device = OnceRefusing(FLASH, validation_s=0.0)
    projector = LightCrafter(UsbTransport(backend=EmulatedUsb(device)), MANIFEST, quick(settle_s=0.3))
    projector.open()
    plan = PatternPlan(patterns=(LIT.model_copy(update={"exposure_us": 200_000.0}),))
    for refused in itertools.count():
        device.refuse_in = refused
        with suppress(DriverError):
            projector.load(plan, 210_000)
            projector.start()
        projector.stop()
        everything_came = device.refuse_in is not None
        device.refuse_in = None
        assert not device.running, f"still running where command {refused} was refused"
        assert not device.light().any(), f"still lit where command {refused} was refused"
        if everything_came:
            break
    assert refused > 10
    projector.close()


def test_a_validation_that_does_not_end_is_left_by_stop() -> None:
    device = EmulatedController(FLASH)
    device.faults.stuck_validation = True
    projector = LightCrafter(UsbTransport(backend=EmulatedUsb(device)), MANIFEST, quick(validate_s=30.0))
    projector.open()
    with ThreadPoolExecutor(1) as pool:
        loading = pool.submit(projector.load, PatternPlan(patterns=(LIT,)), 9000)
        time.sleep(0.3)
        begun = time.monotonic()
        projector.stop()
        assert time.monotonic() - begun < 1.0
        with pytest.raises(ProtocolError, match="was stopped"):
            loading.result()
    projector.close()
