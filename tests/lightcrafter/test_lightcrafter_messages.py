"""Commands and messages of the controller against the bytes of its sheet, and against damage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from worked_examples import EXAMPLES, SEQUENCE, Example

from drivers.errors import ProtocolError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import BY_REGISTER, BY_USB, TABLE, Access
from drivers.lightcrafter.messages import MAXIMUM_PAYLOAD, REPORT_BYTES, Reply, Request, reports_of
from drivers.lightcrafter.values import (
    Currents,
    HardwareStatus,
    LedSelect,
    LutControl,
    LutEntry,
    Release,
    Timing,
    Trigger,
    Validation,
    Versions,
    words,
)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.number)
def test_the_sheets_examples_hold_in_both_directions(example: Example) -> None:
    payload = b"" if example.read else example.command.encode(example.value)
    request = Request(example.command.usb, SEQUENCE, payload, read=example.read)
    assert request.encode() == example.request_bytes
    assert Request.decode(example.request_bytes) == request
    way = Access.READ if example.read else Access.WRITE
    assert BY_USB[request.code, way].usb == example.command.usb

    reply = Reply.decode(example.reply_bytes)
    assert (reply.sequence, reply.refused) == (SEQUENCE, False)
    if example.read:
        assert example.command.decode(reply.data) == example.value
        made = Reply(SEQUENCE, example.command.encode(example.value))
        assert made.encode(flags=0xC0) == example.reply_bytes
    else:
        assert example.command.decode(payload) == example.value


def test_registers_of_the_sheets_i2c_examples() -> None:
    """`E9 01` pattern mode, `F8 00 78 04` data ...: the register with its write bit."""
    named = {
        0xE9: c.DISPLAY_MODE,
        0xEF: c.PATTERN_SOURCE,
        0xF0: c.TRIGGER_MODE,
        0xE6: c.TIMING,
        0xF5: c.LUT_CONTROL,
        0xF7: c.MAILBOX_SELECT,
        0xF6: c.MAILBOX_OFFSET,
        0xF8: c.PATTERN_ENTRIES,
        0xFD: c.VALIDATE,
        0xE5: c.RUN,
    }
    for byte, command in named.items():
        assert command.register == byte & 0x7F
        assert BY_REGISTER[byte & 0x7F, Access.WRITE] is command


def test_a_code_and_a_register_stand_for_one_command_only() -> None:
    """Two commands that share a code differ in direction, or in what the open mailbox makes of them."""
    mailbox = {c.PATTERN_ENTRIES, c.IMAGE_INDEXES}
    for way in (Access.READ, Access.WRITE):
        there = [command for command in TABLE if way in command.access and command not in mailbox]
        assert len({command.usb for command in there}) == len(there)
        registers = [command.register for command in there if command.register is not None]
        assert len(set(registers)) == len(registers)


BYTE = st.integers(0, 255)
U32 = st.integers(0, 2**32 - 1)
RELEASES = st.builds(Release, BYTE, BYTE, st.integers(0, 65535))
ENTRIES = st.builds(
    LutEntry,
    number=st.integers(0, 63),
    depth=st.integers(1, 8),
    trigger=st.sampled_from(Trigger),
    leds=st.integers(0, 7).map(LedSelect),
    inverted=st.booleans(),
    black=st.booleans(),
    swap=st.booleans(),
    share=st.booleans(),
)
VALUES = st.one_of(
    st.tuples(st.just(c.TIMING), st.builds(Timing, U32, U32)),
    st.tuples(st.just(c.VERSION), st.builds(Versions, RELEASES, RELEASES, RELEASES, RELEASES)),
    st.tuples(st.just(c.LED_CURRENT), st.builds(Currents, BYTE, BYTE, BYTE)),
    st.tuples(
        st.just(c.LUT_CONTROL),
        st.builds(LutControl, st.integers(1, 128), st.booleans(), st.integers(1, 256), st.integers(1, 64)),
    ),
    st.tuples(st.just(c.PATTERN_ENTRIES), st.lists(ENTRIES, max_size=128).map(tuple)),
    st.tuples(st.just(c.IMAGE_INDEXES), st.lists(BYTE, max_size=64).map(tuple)),
)


@given(VALUES, BYTE)
def test_every_value_survives_the_way_there(pair: tuple[Any, Any], sequence: int) -> None:
    command, value = pair
    request = Request(command.usb, sequence, command.encode(value))
    raw = request.encode()
    assert len(raw) % REPORT_BYTES == 0
    assert reports_of(raw) == len(raw) // REPORT_BYTES
    assert command.decode(Request.decode(raw).payload) == value


@given(st.binary(max_size=MAXIMUM_PAYLOAD), BYTE, st.booleans(), BYTE)
def test_every_reply_survives_the_way_back_whatever_its_other_flags(
    data: bytes, sequence: int, refused: bool, flags: int
) -> None:
    reply = Reply(sequence, data, refused)
    assert Reply.decode(reply.encode(flags)) == reply


def complaint(parse: Callable[[bytes], object], data: bytes, default: str = "projector: ") -> str:
    """Text of the ProtocolError, ``default`` where the bytes are taken; any other error passes."""
    try:
        parse(data)
    except ProtocolError as error:
        return str(error)
    return default


@given(st.binary(max_size=80))
def test_any_bytes_are_a_reply_or_a_protocol_error(data: bytes) -> None:
    for parse in (Reply.decode, Request.decode, reports_of):
        assert complaint(parse, data).startswith("projector: ")


@given(st.sampled_from(TABLE), st.binary(max_size=40))
def test_any_payload_is_a_value_or_a_protocol_error_that_names_the_command(command: Any, data: bytes) -> None:
    assert command.name in complaint(command.decode, data, default=command.name)


@pytest.mark.parametrize("cut", [0, 3, 4, 10, 63])
def test_a_cut_answer_is_no_answer(cut: int) -> None:
    whole = Reply(1, bytes(60)).encode()
    with pytest.raises(ProtocolError):
        Reply.decode(whole[:cut])


def test_a_short_value_is_told_with_the_command() -> None:
    with pytest.raises(ProtocolError, match=r"'version'.* 3 bytes came where 16 belong"):
        c.VERSION.decode(b"abc")


@pytest.mark.parametrize(
    ("command", "value"),
    [
        (c.TIMING, Timing(-1, 8333)),
        (c.TIMING, Timing(2**32, 8333)),
        (c.LED_CURRENT, Currents(0, 256, 0)),
        (c.LUT_CONTROL, LutControl(129, False, 129, 1)),
        (c.LUT_CONTROL, LutControl(0, False, 1, 1)),
        (c.LUT_CONTROL, LutControl(1, False, 1, 65)),
        (c.IMAGE_INDEXES, (256,)),
    ],
)
def test_a_value_that_does_not_fit_is_not_sent(command: Any, value: Any) -> None:
    with pytest.raises(ProtocolError, match=command.name):
        command.encode(value)


def test_a_message_beyond_the_longest_is_not_sent() -> None:
    with pytest.raises(ProtocolError, match="506 are the most"):
        Request(0x1A34, 1, bytes(MAXIMUM_PAYLOAD + 1)).encode()


def test_a_full_pattern_lut_takes_seven_reports() -> None:
    entries = (LutEntry(0, 8),) * 128
    assert len(Request(0x1A34, 1, c.PATTERN_ENTRIES.encode(entries)).encode()) == 7 * REPORT_BYTES


def test_status_words_name_what_is_set() -> None:
    assert words(Validation.EXPOSURE_INVALID | Validation.GAP_SHORT) == (
        "the exposure or the period is out of range; the dark time after each pattern is below 230 us"
    )
    assert words(HardwareStatus.INITIALISED) == ""
    assert words(HardwareStatus.DMD_RESET_ERROR) == "the DMD reset controller failed"
