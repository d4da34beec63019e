"""The serial transport on real pyserial, with emulated bridges behind pseudo-terminals."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from lightcrafter_benches import MANIFEST, PLAN, SMALL, controller, quick, serial_port

from drivers.errors import DeviceBusyError, DeviceLostError, DeviceNotFoundError, ProtocolError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.bridges import BusPirate, UsbIss
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.i2c_device import EmulatedBusPirate, EmulatedUsbIss, I2cSlave
from drivers.lightcrafter.emulator.serial_port import EmulatedSerialPort
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.serial import SerialTransport
from drivers.lightcrafter.transport import Transport, read, write
from drivers.lightcrafter.values import ImageRange, LutEntry, Mailbox, MainStatus, Release, Timing

Wired = tuple[Transport, EmulatedSerialPort, EmulatedController]


@pytest.fixture(params=["usb-iss", "bus-pirate"])
def wired(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Wired]:
    """An open transport, its port, and the controller."""
    device = controller()
    with serial_port(device, request.param, tmp_path) as (transport, port):
        transport.open()
        yield transport, port, device
        transport.close()


def test_what_is_written_reads_back(wired: Wired) -> None:
    transport, _, _ = wired
    assert read(transport, c.VERSION).application == Release(4, 4, 0)
    assert read(transport, c.FIRMWARE_TAG) == "emulated"
    write(transport, c.TIMING, Timing(8333, 9000))
    assert read(transport, c.TIMING) == Timing(8333, 9000)


def test_as_many_lut_entries_as_one_write_takes_arrive(wired: Wired) -> None:
    transport, _, device = wired
    entries = tuple(LutEntry(k, 1) for k in range(transport.largest_payload // 3))
    assert len(entries) == 20
    write(transport, c.MAILBOX_SELECT, Mailbox.PATTERNS)
    write(transport, c.MAILBOX_OFFSET, 40)
    write(transport, c.PATTERN_ENTRIES, entries)
    assert tuple(device.entries[40 + k] for k in range(20)) == entries


def test_a_plan_longer_than_one_write_arrives_whole(tmp_path: Path) -> None:
    device = controller(realtime=False)
    with serial_port(device, "usb-iss", tmp_path) as (transport, _):
        projector = LightCrafter(transport, MANIFEST, quick())
        projector.open()
        projector.load(PLAN, 8600.0)
        projector.start()
        for pattern in PLAN.patterns:
            exposure = device.step()
            assert exposure is not None
            assert np.array_equal(exposure.levels, pattern.render(SMALL)), pattern.name
        projector.close()


def test_an_answer_that_is_not_ready_is_asked_for_again(wired: Wired) -> None:
    transport, _, device = wired
    device.faults.busy_reads = 3
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)


def test_a_refusal_names_the_command(wired: Wired) -> None:
    transport, _, device = wired
    device.faults.refused.add(c.TIMING.name)
    with pytest.raises(ProtocolError, match="refused 'exposure and period'"):
        read(transport, c.TIMING)


def test_a_refused_write_of_the_iss_names_the_command(tmp_path: Path) -> None:
    """The Bus Pirate knows of a refusal only by a register that does not exist."""
    device = controller()
    device.faults.refused.add(c.TIMING.name)
    with serial_port(device, "usb-iss", tmp_path) as (transport, _):
        transport.open()
        with pytest.raises(ProtocolError, match="refused 'exposure and period'"):
            write(transport, c.TIMING, Timing(9000, 9000))
        transport.close()


@pytest.mark.parametrize("way", ["read", "write"])
def test_a_controller_without_power_is_a_loss(wired: Wired, way: str) -> None:
    transport, _, device = wired
    device.unplug()
    with pytest.raises(DeviceLostError, match="I2C address 0x1a; check its wires and power"):
        write(transport, c.TIMING, Timing(9000, 9000)) if way == "write" else read(transport, c.TIMING)
    device.plug()
    assert read(transport, c.MAIN_STATUS) == MainStatus(0)


def test_a_pulled_bridge_is_a_loss_until_it_is_back(wired: Wired) -> None:
    transport, port, _ = wired
    port.unplug()
    with pytest.raises(DeviceLostError, match="lost behind its"):
        read(transport, c.MAIN_STATUS)
    transport.close()
    transport.close()
    with pytest.raises(DeviceNotFoundError, match="cannot be opened"):
        transport.open()
    with pytest.raises(DeviceLostError, match="not open"):
        read(transport, c.MAIN_STATUS)


def test_a_port_in_use_is_busy(wired: Wired) -> None:
    _, port, _ = wired
    with pytest.raises(DeviceBusyError, match="another program"):
        SerialTransport(str(port.path), UsbIss()).open()


def test_what_i2c_has_no_register_for_is_not_asked(wired: Wired) -> None:
    transport, _, _ = wired
    assert not transport.carries(c.IMAGE_LOAD_TIME)
    with pytest.raises(ProtocolError, match="over I2C; use USB"):
        write(transport, c.IMAGE_LOAD_RANGE, ImageRange(0, 1))


def test_another_device_is_not_taken_for_a_bridge(tmp_path: Path) -> None:
    slave = I2cSlave(controller())
    port = EmulatedSerialPort(EmulatedUsbIss(slave, module=0x22), tmp_path / "tty")
    try:
        for bridge in (UsbIss(), BusPirate()):
            with pytest.raises(DeviceNotFoundError, match=f"has no {bridge.name} at"):
                SerialTransport(str(port.path), bridge, timeout_s=0.02).open()
    finally:
        port.unplug()


def test_a_bus_pirate_left_in_its_terminal_is_brought_to_i2c(tmp_path: Path) -> None:
    port = EmulatedSerialPort(EmulatedBusPirate(I2cSlave(controller()), zeros=7), tmp_path / "tty")
    try:
        transport = SerialTransport(str(port.path), BusPirate(pull_ups=True), timeout_s=0.05)
        for _ in range(2):
            transport.open()
            assert read(transport, c.VERSION).application == Release(4, 4, 0)
            transport.close()
    finally:
        port.unplug()
