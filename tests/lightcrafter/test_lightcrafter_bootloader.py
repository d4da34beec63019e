"""The bootloader's commands: bytes on the wire, what is refused before it is sent, and which mode answers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from flash_benches import OLD, QUICK, FlashBench
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceLostError, ProtocolError
from drivers.lightcrafter import bootloader as b
from drivers.lightcrafter.bootloader import (
    LARGEST_DATA,
    SECTOR_BYTES,
    Bootloader,
    FlashError,
    enter,
    running_version,
    wait_for_program,
)
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES
from drivers.lightcrafter.messages import REPORT_BYTES, Request, reports_of
from drivers.lightcrafter.usb import UsbTransport
from drivers.lightcrafter.values import Release

TABLE = BOOTLOADER_BYTES


def request(text: str) -> bytes:
    """Of the sheet's notation, sequence number 1."""
    return bytes.fromhex(text.replace("ss", "01")).ljust(64, b"\0")


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (Request(b.PROGRAM_MODE.usb, 1, b.PROGRAM_MODE.encode(b.ENTER), acknowledged=False), "00 ss 03 00 01 30 01"),
        (Request(b.STATUS.usb, 1, bytes([b.ASK_MANUFACTURER]), read=True), "C0 ss 03 00 15 00 0C"),
        (Request(b.STATUS.usb, 1, bytes([b.ASK_DEVICE]), read=True), "C0 ss 03 00 15 00 0D"),
        (Request(b.STATUS.usb, 1, bytes([b.ASK_SUM]), read=True), "C0 ss 03 00 15 00 00"),
        (Request(b.FLASH_TYPE.usb, 1, b.FLASH_TYPE.encode(0)), "40 ss 03 00 2F 00 00"),
        (Request(b.ADDRESS.usb, 1, b.ADDRESS.encode(0x20000)), "40 ss 06 00 29 00 00 00 02 00"),
        (Request(b.ERASE.usb, 1), "40 ss 02 00 28 00"),
        (Request(b.SIZE.usb, 1, b.SIZE.encode(0x20000)), "40 ss 06 00 2C 00 00 00 02 00"),
        (Request(b.CHECKSUM.usb, 1, acknowledged=False), "00 ss 02 00 26 00"),
        (Request(b.EXIT.usb, 1, b.EXIT.encode(b.LEAVE), acknowledged=False), "00 ss 03 00 30 00 02"),
        (Request(b.DATA.usb, 1, b"\xaa\xbb", acknowledged=False), "00 ss 04 00 25 00 AA BB"),
    ],
    ids=lambda value: None if isinstance(value, str) else f"{value.code:04X}",
)
def test_messages_are_those_of_the_sheet(message: Request, expected: str) -> None:
    assert message.encode() == request(expected)
    assert Request.decode(request(expected)) == message


def test_a_whole_message_of_data_takes_eight_reports() -> None:
    assert LARGEST_DATA == 504
    raw = Request(b.DATA.usb, 1, bytes(range(252)) * 2, acknowledged=False).encode()
    assert len(raw) == 8 * REPORT_BYTES
    assert reports_of(raw) == 8
    assert raw[6:64] == bytes(range(58)), "58 bytes of data in the first report"
    assert Request.decode(raw).payload == bytes(range(252)) * 2


@pytest.fixture
def bench(tmp_path: Path) -> Any:
    made = FlashBench(tmp_path / "flash.bin")
    yield made
    made.assert_bootloader_untouched()


@pytest.fixture
def opened(bench: FlashBench) -> Any:
    """A transport to a controller that waits in its bootloader."""
    transport = bench.transport()
    enter(transport, QUICK)
    yield transport
    transport.close()


def test_a_sector_is_erased_written_and_summed(bench: FlashBench, opened: UsbTransport) -> None:
    loader = Bootloader(opened, QUICK)
    part = loader.identify()
    assert (part.name, part.algorithm, part.size) == ("M29DW128G", 0, 32 << 20)
    loader.select(part)
    loader.erase(0x40000)
    assert loader.checksum(0x40000, SECTOR_BYTES) == 0xFF * SECTOR_BYTES
    content = bytes(range(256)) * 5 + b"odd"
    loader.write(0x40000 + 6, content)
    assert bench.bootloader.memory[0x40000 + 6 :][: len(content)] == content
    assert loader.checksum(0x40000 + 6, len(content)) == sum(content)
    assert bench.bootloader.memory[0x40000 : 0x40000 + 6] == b"\xff" * 6


def test_a_sum_is_of_32_bits(bench: FlashBench, opened: UsbTransport) -> None:
    """The whole flash of 32 MB could sum to twice that."""
    whole = sum(bench.bootloader.memory[TABLE:])
    assert Bootloader(opened, QUICK).checksum(TABLE, 0x80000 - TABLE) == whole % (1 << 32)


@given(
    st.one_of(st.integers(0, BOOTLOADER_BYTES - 1), st.sampled_from([0, 1, BOOTLOADER_BYTES - 1])),
    st.integers(1, 4 * SECTOR_BYTES),
)
def test_nothing_below_the_bootloaders_end_is_ever_sent(address: int, size: int) -> None:
    silent: Any = None  # a transport that was touched would fail otherwise
    loader = Bootloader(silent, QUICK)
    for touch in (loader.erase, lambda at: loader.write(at, bytes(size))):
        with pytest.raises(FlashError, match="refusing to touch"):
            touch(address)


@pytest.mark.parametrize(
    ("address", "size"), [(TABLE, 0), (TABLE, SECTOR_BYTES + 1), (TABLE + 4, SECTOR_BYTES), (TABLE - 1, 1)]
)
def test_a_write_stays_within_its_sector(bench: FlashBench, opened: UsbTransport, address: int, size: int) -> None:
    with pytest.raises(FlashError, match="nothing was sent"):
        Bootloader(opened, QUICK).write(address, bytes(size))
    with pytest.raises(FlashError, match="nothing was sent"):
        Bootloader(opened, QUICK).erase(TABLE + 1)
    assert bench.bootloader.log == []


def test_the_mode_shows_in_who_answers(bench: FlashBench) -> None:
    transport = bench.transport()
    transport.open()
    version = running_version(transport)
    assert version is not None
    assert version.application == Release(4, 4, 0)
    enter(transport, QUICK)
    for deaf in (False, True):
        bench.bootloader.faults.deaf = deaf
        assert running_version(transport) is None
    Bootloader(transport, QUICK).leave()
    assert wait_for_program(transport, QUICK).application == Release(4, 4, 0)
    transport.close()


def test_a_controller_that_answers_nothing_is_told(bench: FlashBench, monkeypatch: pytest.MonkeyPatch) -> None:
    transport = bench.transport(timeout_s=0.02)
    transport.open()
    monkeypatch.setattr(bench.bus, "_answer", lambda request: None)
    with pytest.raises(DeviceLostError, match="neither as a projector nor as a bootloader"):
        running_version(transport)
    transport.close()


def test_an_answer_that_is_too_short_is_nonsense(opened: UsbTransport, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opened, "ask", lambda command, argument: b"\0\0\0")
    with pytest.raises(ProtocolError, match="answered nonsense to 'bootloader status': 3 bytes"):
        Bootloader(opened, QUICK).identify()


def test_no_message_reaches_a_closed_transport(bench: FlashBench) -> None:
    calls: list[Callable[[], object]] = [
        lambda: bench.transport().post(b.DATA, b"x"),
        lambda: bench.transport().ask(b.STATUS, b"\0"),
    ]
    for call in calls:
        with pytest.raises(DeviceLostError, match="not open"):
            call()


class TestEmulatedBootloader:
    """It must be able to show what a driver does wrong."""

    def test_a_write_only_clears_bits(self, bench: FlashBench, opened: UsbTransport) -> None:
        old = bench.bootloader.memory[0x40000:0x40004]
        Bootloader(opened, QUICK).write(0x40000, b"\x55" * 4)
        assert bench.bootloader.memory[0x40000:0x40004] == bytes(o & 0x55 for o in old)

    def test_an_erase_needs_the_type_of_the_flash(self, opened: UsbTransport) -> None:
        with pytest.raises(ProtocolError, match="refused 'sector erase'"):
            Bootloader(opened, QUICK).erase(0x40000)

    def test_a_table_before_a_whole_program_ends_the_controller(self, bench: FlashBench, opened: UsbTransport) -> None:
        loader = Bootloader(opened, QUICK)
        loader.select(loader.identify())
        loader.erase(0x40000)
        loader.leave()
        assert not bench.device.plugged
        bench.device.plug()
        assert not bench.device.plugged

    def test_what_lies_behind_the_longest_message_is_lost(self, bench: FlashBench, opened: UsbTransport) -> None:
        loader = Bootloader(opened, QUICK)
        loader.select(loader.identify())
        loader.erase(0x40000)
        opened.request(b.SIZE, b.SIZE.encode(LARGEST_DATA + 1))
        opened.post(b.DATA, bytes(LARGEST_DATA + 1))
        loader.checksum(0x40000, 1)
        assert bench.bootloader.memory[0x40000 + LARGEST_DATA] == 0xFF

    def test_a_handle_dies_with_the_visit_to_the_bus(self, bench: FlashBench) -> None:
        transport = bench.transport()
        transport.open()
        transport.post(b.PROGRAM_MODE, b.PROGRAM_MODE.encode(b.ENTER))
        with pytest.raises(DeviceLostError, match="answers neither"):
            running_version(transport)
        assert bench.bootloader.memory[: len(OLD)] == OLD
        transport.close()
