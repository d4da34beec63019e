"""The simulated camera by itself: its packets, its sensor, its numbers. Needs no library."""

from __future__ import annotations

import itertools
import socket
import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aravis.discovery import privilege
from drivers.genicam.connection import FrameIds
from drivers.gigevision import SimulatedGrasshopper
from drivers.gigevision.features import SENSOR_SIZE
from drivers.gigevision.pictures import as_pixels, number_on, numbered_ramp
from drivers.gigevision.protocol import (
    CONTROL_PORT,
    PIXEL_FORMATS,
    Bootstrap,
    Command,
    make_request,
    parse_answer,
    parse_request,
)
from drivers.gigevision.sensor import Sensor

READOUT_S = 480 * 5.17e-6


@pytest.fixture
def camera(address: Callable[[int], str]) -> Iterator[SimulatedGrasshopper]:
    with SimulatedGrasshopper(address(0), "1") as camera:
        yield camera


@pytest.fixture
def asking(camera: SimulatedGrasshopper) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.connect((camera.address, CONTROL_PORT))
        asking.settimeout(2.0)
        yield asking


def write(asking: socket.socket, register: int, value: int) -> int:
    """The status of the answer."""
    asking.send(make_request(Command.WRITE_REGISTERS, 7, struct.pack(">II", register, value)))
    return int.from_bytes(asking.recv(1024)[:2], "big")


@given(st.binary(max_size=64))
def test_any_bytes_are_a_request_or_none(packet: bytes) -> None:
    request = parse_request(packet)
    if request is not None:
        assert packet[0] == 0x42
        assert len(request.body) <= len(packet) - 8


@given(st.sampled_from(list(Command)), st.integers(1, 0xFFFF), st.binary(max_size=64))
def test_a_request_arrives_as_made(command: Command, number: int, body: bytes) -> None:
    request = parse_request(make_request(command, number, body))
    assert request is not None
    assert (request.command, request.number, request.body) == (command, number, body)


@given(st.binary(max_size=64))
def test_any_bytes_are_an_answer_or_none(packet: bytes) -> None:
    body = parse_answer(packet, Command.READ_REGISTERS, 1)
    assert body is None or packet[:2] == b"\0\0"


def test_nonsense_is_survived(camera: SimulatedGrasshopper, asking: socket.socket) -> None:
    """Every command with bodies of every length, random bytes, nothing."""
    random = np.random.default_rng(1)
    for command, length in itertools.product((*Command, 0x77), (0, 1, 3, 4, 7, 8, 9, 16)):
        asking.send(struct.pack(">BBHHH", 0x42, 1, command, length, 1) + random.bytes(length))
    for length in range(0, 80, 5):
        asking.send(random.bytes(length))
    assert privilege(camera.address) == 0


def test_one_controller_at_a_time(camera: SimulatedGrasshopper, asking: socket.socket) -> None:
    assert write(asking, Bootstrap.HEARTBEAT_MS, 1000) == 0x8006
    assert write(asking, Bootstrap.PRIVILEGE, 2) == 0
    assert privilege(camera.address) == 2
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.connect((camera.address, CONTROL_PORT))
        other.settimeout(2.0)
        assert write(other, Bootstrap.PRIVILEGE, 2) == 0x8006
        assert write(other, Bootstrap.HEARTBEAT_MS, 1) == 0x8006
        assert write(asking, Bootstrap.PRIVILEGE, 0) == 0
        assert write(other, Bootstrap.PRIVILEGE, 2) == 0


def test_a_silent_controller_loses_its_privilege(camera: SimulatedGrasshopper, asking: socket.socket) -> None:
    write(asking, Bootstrap.PRIVILEGE, 2)
    write(asking, Bootstrap.HEARTBEAT_MS, 100)
    waits = (privilege(camera.address) for _ in itertools.count())
    assert next(held for held in itertools.islice(waits, 200_000) if held == 0) == 0


def test_registers_refuse_what_they_cannot_hold(asking: socket.socket) -> None:
    write(asking, Bootstrap.PRIVILEGE, 2)
    assert write(asking, Bootstrap.SERIAL, 1) == 0x8004
    assert write(asking, 0x9000_0000, 1) == 0x8003
    width = 0x1_0000
    assert write(asking, width, 640) == 0
    assert write(asking, width, 650) == 0x8002
    assert write(asking, width, 1952) == 0x8002


@given(
    exposure_us=st.floats(100, 20_000),
    pulses_us=st.lists(st.floats(0, 30_000), min_size=1, max_size=30),
    overlap=st.booleans(),
)
def test_exposures_never_overlap_and_none_is_lost_without_need(
    exposure_us: float, pulses_us: list[float], overlap: bool
) -> None:
    """Exposures keep clear of one another, readouts follow one another, and a pulse is lost only to a busy sensor."""
    sensor = Sensor()
    now_s, taken = 100.0, []
    for gap_us in pulses_us:
        now_s += 1e-6 * gap_us
        exposure = sensor.expose(now_s, exposure_us, 0.0, 480, overlap=overlap)
        before = taken[-1] if taken else None
        if exposure is None:
            assert before is not None
            busy_until_s = before.start_s + 1e-6 * exposure_us if overlap else before.read_s
            assert now_s < busy_until_s + 1e-9
            continue
        assert exposure.start_s >= now_s
        if before is not None:
            assert exposure.start_s >= before.start_s + 1e-6 * exposure_us - 1e-9
            assert exposure.read_s >= before.read_s + READOUT_S - 1e-9
            if not overlap:
                assert exposure.start_s == now_s
        taken.append(exposure)
    assert [exposure.block for exposure in taken] == list(range(1, len(taken) + 1))


@given(
    first=st.integers(0, 200_000),
    steps=st.lists(st.integers(1, 30_000), max_size=30),
)
def test_ids_that_wrap_are_counted_on(first: int, steps: list[int]) -> None:
    """16 bits from 1, 65535 is followed by 1; the count goes on, and what is missing shows."""
    ids = FrameIds(gige=True)
    climb = range(0, first, 20_000)
    for number in climb:
        assert ids.count(number % 0xFFFF + 1) == number
    sent = [first, *(first + total for total in itertools.accumulate(steps))]
    assert [ids.count(number % 0xFFFF + 1) for number in sent] == sent
    assert ids.missing == sent[-1] + 1 - len({*climb, *sent})


def test_ids_of_usb_cameras_are_taken_as_they_are() -> None:
    ids = FrameIds(gige=False)
    assert [ids.count(number) for number in (0, 1, 3, 70_000)] == [0, 1, 3, 70_000]
    assert ids.missing == 70_001 - 4


def test_ids_of_usb_cameras_may_begin_with_one() -> None:
    ids = FrameIds(gige=False, first=1)
    assert [ids.count(number) for number in (1, 2, 4)] == [0, 1, 3]
    assert ids.missing == 1


@given(st.integers(0, 0xFFFF), st.sampled_from([(640, 480), (1920, 1200), (992, 16), (32, 8)]))
def test_the_number_on_a_picture_is_read_back(index: int, size: tuple[int, int]) -> None:
    image = numbered_ramp(index, 20.0, 0.0, size)
    assert image.shape == size[::-1]
    assert number_on(image) == index


@pytest.mark.parametrize("roi", [(160, 94, 880, 553), (200, 120, 860, 540), (96, 64, 900, 560)])
def test_a_small_picture_lies_in_the_middle_of_the_sensor(roi: tuple[int, int, int, int]) -> None:
    picture = np.arange(96 * 160, dtype=np.uint8).reshape(96, 160)
    width, height, x, y = roi
    seen = np.frombuffer(as_pixels(picture, roi, PIXEL_FORMATS["Mono8"]), np.uint8).reshape(height, width)
    left, top = (SENSOR_SIZE[0] - 160) // 2 - x, (SENSOR_SIZE[1] - 96) // 2 - y
    for row, column in ((40, 60), (50, 70)):
        assert seen[row + top, column + left] == picture[row, column]
    if top > 0:
        assert not seen[:top].any()
