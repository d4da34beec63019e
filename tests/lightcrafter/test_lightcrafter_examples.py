"""The sheet's examples as one conversation: their bytes go to the emulated controller, its bytes come back."""

from __future__ import annotations

import array
import time
from types import SimpleNamespace

import pytest
from lightcrafter_benches import controller
from worked_examples import ACK, EXAMPLES, SEQUENCE, Example, unhex

from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.usb_device import EmulatedUsb
from drivers.lightcrafter.messages import Reply
from drivers.lightcrafter.values import LutEntry, Trigger

BY_NUMBER = {example.number: example for example in EXAMPLES}
IMAGE_LUT = ("40 ss 03 00 33 1A 01", "40 ss 03 00 32 1A 00", "40 ss 03 00 34 1A 00", "40 ss 03 00 33 1A 00")


class Wire:
    """Reports as they are, to and from an emulated controller."""

    def __init__(self, device: EmulatedController) -> None:
        self.bus = EmulatedUsb(device)
        self.handle: SimpleNamespace = self.bus.open_device((2,))

    def exchange(self, report: bytes) -> bytes:
        self.bus.intr_write(self.handle, 0x01, 0, array.array("B", report), 100)
        answer = array.array("B", bytes(64))
        assert self.bus.intr_read(self.handle, 0x81, 0, answer, 100) == 64
        return bytes(answer)

    def play(self, example: Example) -> None:
        """The sheet leaves the first byte of a reply open but for the bit of refusal, and the length of an ack."""
        answer = self.exchange(example.request_bytes)
        assert answer[1:] == example.reply_bytes[1:], example.number
        assert not answer[0] & 0x20, example.number


def test_every_example_of_the_sheet_is_here() -> None:
    assert {int(example.number.split()[0]) for example in EXAMPLES} == set(range(1, 15))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.number)
def test_an_acknowledgement_is_made_as_it_is_read(example: Example) -> None:
    if not example.read:
        assert example.reply == ACK
        assert Reply(SEQUENCE).encode(flags=0x40) == example.reply_bytes
    assert Reply.decode(example.reply_bytes).encode(flags=example.reply_bytes[0]) == example.reply_bytes


def test_the_examples_in_their_order_show_a_sequence() -> None:
    device = controller(validation_s=0.05)
    wire = Wire(device)
    for number in ("1", "4", "5", "13", "8", "6", "7", "9 open", "9 offset", "10", "9 close"):
        wire.play(BY_NUMBER[number])
    version = wire.exchange(BY_NUMBER["3"].request_bytes)
    assert version[1:8] == BY_NUMBER["3"].reply_bytes[1:8], "length and version of the application"
    for text in IMAGE_LUT:
        assert not wire.exchange(unhex(text))[0] & 0x20
    for number in ("12 start", "12 busy"):
        wire.play(BY_NUMBER[number])
    time.sleep(0.06)
    for number in ("12 done", "14", "2"):
        wire.play(BY_NUMBER[number])
    assert device.running
    assert tuple(device.entries[k] for k in range(3)) == BY_NUMBER["10"].value
    assert c.LED_CURRENT.decode(device.handle(c.LED_CURRENT.usb, None)) == BY_NUMBER["13"].value
    assert c.TIMING.decode(device.handle(c.TIMING.usb, None)) == BY_NUMBER["7"].value
    device.unplug()


def test_the_entries_of_the_video_example_arrive() -> None:
    device = controller()
    wire = Wire(device)
    for number in ("9 open", "9 offset", "11", "9 close"):
        wire.play(BY_NUMBER[number])
    assert device.entries[0] == LutEntry(0, 8, Trigger.EXTERNAL_POSITIVE, swap=True)
    assert device.entries[2] == LutEntry(2, 8, Trigger.CONTINUE)
