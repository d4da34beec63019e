"""The USB transport on real pyusb before an emulated controller: who says what when something is wrong."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
import usb.backend.libusb0
import usb.backend.libusb1
import usb.backend.openusb
from lightcrafter_benches import controller, usb_transport

from drivers.errors import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceUnavailableError,
    ProtocolError,
)
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.messages import Reply
from drivers.lightcrafter.transport import read, write
from drivers.lightcrafter.usb import UsbTransport
from drivers.lightcrafter.values import LutEntry, Mailbox, MainStatus, Release, Run, Timing

Wired = tuple[UsbTransport, EmulatedUsb, EmulatedController]


@pytest.fixture
def wired() -> Iterator[Wired]:
    """A transport, not yet open, its bus, and the controller."""
    device = controller()
    transport, bus = usb_transport(device, timeout_s=0.5)
    yield transport, bus, device
    transport.close()
    assert bus.resets == 0, "the device was reset, which makes it leave the bus"


def test_what_is_written_reads_back(wired: Wired) -> None:
    transport, _, _ = wired
    transport.open()
    assert transport.location == "USB 1-2"
    assert read(transport, c.VERSION).application == Release(4, 4, 0)
    for exposure_us in range(8333, 8333 + 300):
        write(transport, c.TIMING, Timing(exposure_us, exposure_us))
        assert read(transport, c.TIMING).exposure_us == exposure_us


def test_a_message_of_seven_reports_arrives_whole(wired: Wired) -> None:
    transport, _, device = wired
    transport.open()
    entries = tuple(LutEntry(k % 24, 1, swap=k == 0) for k in range(128))
    write(transport, c.MAILBOX_SELECT, Mailbox.PATTERNS)
    write(transport, c.PATTERN_ENTRIES, entries)
    assert tuple(device.entries[k] for k in range(128)) == entries


def test_the_kernels_driver_is_detached_and_put_back(wired: Wired) -> None:
    transport, bus, _ = wired
    transport.open()
    assert not bus.kernel_driver
    assert bus.claimed
    transport.close()
    assert bus.kernel_driver
    assert not bus.claimed
    bus.kernel_driver = False
    transport.open()
    transport.close()
    assert not bus.kernel_driver, "a driver was attached that was not there before"


def test_answers_left_by_an_earlier_program_are_not_taken_for_ours(wired: Wired) -> None:
    transport, bus, _ = wired
    for sequence in range(5):
        bus.leave_report(Reply(sequence, b"\xff" * 16).encode())
    transport.open()
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)


def test_answers_with_another_sequence_number_are_dropped(wired: Wired) -> None:
    transport, _, device = wired
    transport.open()
    device.faults.stale_replies = 3
    assert read(transport, c.VERSION).application == Release(4, 4, 0)
    write(transport, c.TIMING, Timing(9000, 9000))
    assert read(transport, c.TIMING) == Timing(9000, 9000)


def test_a_late_answer_is_not_taken_for_the_next_one(wired: Wired) -> None:
    transport, bus, device = wired
    transport.open()
    device.faults.silent.add(c.MAIN_STATUS.name)
    with pytest.raises(DeviceLostError, match=r"did not answer 'main status' within 0\.5 s"):
        read(transport, c.MAIN_STATUS)
    device.faults.silent.clear()
    bus.leave_report(Reply(bus.last_sequence, b"\x02").encode())
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)


def test_a_slow_controller_is_waited_for_and_a_dead_one_not_for_long(wired: Wired) -> None:
    transport, _, device = wired
    transport.open()
    device.faults.delay_s = 0.05
    assert read(transport, c.RUN) is Run.STOP
    device.faults.silent.add(c.RUN.name)
    started = time.monotonic()
    with pytest.raises(DeviceLostError):
        read(transport, c.RUN)
    assert time.monotonic() - started < 2.0


@pytest.mark.parametrize("way", ["read", "write"])
def test_a_refusal_names_the_command(wired: Wired, way: str) -> None:
    transport, _, device = wired
    transport.open()
    device.faults.refused.add(c.TIMING.name)
    with pytest.raises(ProtocolError, match="projector: refused 'exposure and period'"):
        write(transport, c.TIMING, Timing(9000, 9000)) if way == "write" else read(transport, c.TIMING)
    device.faults.refused.clear()
    assert read(transport, c.TIMING) == Timing(8333, 8333)


@pytest.mark.parametrize("report", [b"\xc0\x01\xff\xff", b"\xc0\x01\x05\x02" + bytes(60)])
def test_an_answer_of_impossible_length_is_nonsense(wired: Wired, report: bytes) -> None:
    transport, bus, _ = wired
    transport.open()
    bus.leave_report(report)
    with pytest.raises(ProtocolError):
        read(transport, c.MAIN_STATUS)


def test_a_pulled_cable_is_a_loss(wired: Wired) -> None:
    transport, _, device = wired
    transport.open()
    device.unplug()
    with pytest.raises(DeviceLostError, match="check its cable and power"):
        read(transport, c.MAIN_STATUS)
    transport.close()
    with pytest.raises(DeviceLostError, match="not open"):
        read(transport, c.MAIN_STATUS)
    with pytest.raises(DeviceNotFoundError, match="0451:6401"):
        transport.open()
    device.plug()
    transport.open()
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)


def test_the_systems_refusals_have_their_own_names(wired: Wired) -> None:
    transport, bus, _ = wired
    bus.denied = True
    with pytest.raises(DevicePermissionError, match="udev rule"):
        transport.open()
    bus.denied, bus.held = False, True
    with pytest.raises(DeviceBusyError, match="another program"):
        transport.open()
    assert bus.kernel_driver, "the kernel's driver was not put back after a failure"
    bus.held = False
    transport.open()


def test_one_of_several_is_chosen_by_its_path() -> None:
    bus = EmulatedUsb(controller(), ports=((2,), (3, 1)))
    with pytest.raises(DeviceNotFoundError, match=r"any of 1-2, 1-3\.1; name its USB path"):
        UsbTransport(backend=bus).open()
    with pytest.raises(DeviceNotFoundError, match=r"not at USB path 1-4; there are 1-2, 1-3\.1"):
        UsbTransport("1-4", backend=bus).open()
    transport = UsbTransport("1-3.1", backend=bus)
    transport.open()
    assert transport.location == "USB 1-3.1"
    transport.close()


def test_without_libusb_the_error_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for library in (usb.backend.libusb1, usb.backend.libusb0, usb.backend.openusb):
        monkeypatch.setattr(library, "get_backend", lambda *_, **__: None)
    with pytest.raises(DeviceUnavailableError, match="libusb"):
        UsbTransport().open()
