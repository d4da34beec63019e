"""What tests ask of any device: how it refuses, where it stands, what it leaves behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers.camera import Camera, CameraState
from drivers.errors import DriverError
from drivers.projector import Projector, ProjectorState


@contextmanager
def refused(
    device: Camera | Projector, *kinds: type[DriverError], keeps_state: bool = True
) -> Iterator[pytest.ExceptionInfo[DriverError]]:
    """The block raises one of ``kinds`` in one line that begins with the device's name, and the state stays."""
    before = device.state
    with pytest.raises(kinds) as caught:
        yield caught
    check_message(device, caught.value)
    if keeps_state:
        assert device.state == before, f"a refused call left {device.name} {device.state} where it was {before}"


def check_message(device: Camera | Projector, error: DriverError) -> None:
    """One line, the device's name first, and something after it."""
    text = str(error)
    assert error.device == device.name
    assert text.startswith(f"{device.name}: "), f"{text!r} does not begin with the device's name"
    assert len(text) > len(device.name) + 2, "the error says nothing"
    assert len(text.splitlines()) == 1, f"{text!r} has more than one line"


def assert_state(device: Camera | Projector, state: CameraState | ProjectorState) -> None:
    """The device is in that state now."""
    assert device.state == state, f"{device.name} is {device.state}, should be {state}"


def wait_until(condition: Callable[[], bool], patience_s: float) -> bool:
    """Whether the condition came true in time."""
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.002)
    return True


def assert_no_new_threads(before: set[threading.Thread], patience_s: float) -> None:
    """Every thread that was not in ``before`` has ended or ends in time."""

    def left() -> set[threading.Thread]:
        return {thread for thread in threading.enumerate() if thread.is_alive()} - before

    assert wait_until(lambda: not left(), patience_s), f"threads are left after close: {sorted(map(repr, left()))}"
