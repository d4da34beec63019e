"""Patterns out of the video input: the projector follows a graphics card at 912x1140 and 60 Hz.

Source of the order: TI's guide and GUI, by way of those who used it; none of it was tried on a projector.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.errors import DeviceConfigurationError, DriverError, ProtocolError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import NAME
from drivers.lightcrafter.console import Console
from drivers.lightcrafter.planes import Depth
from drivers.lightcrafter.sequence import video_program
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.transport import Transport
from drivers.lightcrafter.values import (
    Input,
    LedSelect,
    MainStatus,
    Mode,
    PixelFormat,
    Source,
    Validation,
    VideoSignal,
    Width,
    words,
)
from models.patterns import LIGHTCRAFTER_4500

_LOG = logging.getLogger(__name__)
CHANNEL_SWAP = 4
"""Register 1A 37 as TI's GUI sets it on the EVM, and as the exported frames are made for."""
LOCK_S = 1.5
"""How long TI's GUI waits for the controller to lock to a signal."""
_COLUMNS, _ROWS = LIGHTCRAFTER_4500.columns, LIGHTCRAFTER_4500.rows


@contextmanager
def opened(transport: Transport, configuration: LightCrafterConfiguration) -> Iterator[Console]:
    """The procedures of a projector that is awake and dark, and is left dark and closed.

    Raises as ``Projector.open`` does.
    """
    transport.open()
    try:
        console = Console(transport, configuration)
        console.wake()
        console.go_dark()
        console.set_board()
        try:
            yield console
        finally:
            # what went wrong before is the better story
            with suppress(DriverError):
                console.go_dark()
    finally:
        transport.close()


def measure_signal(console: Console, *, channel_swap: int = CHANNEL_SWAP, lock_s: float = LOCK_S) -> VideoSignal:
    """Turn to the video input and wait until the controller has locked to it; the last that it told, locked or not.

    The LEDs stay dark meanwhile; the projector is in video mode afterwards, without which it never locks.
    """
    console.halt()
    console.set_leds(0.0)
    # straight from its test pattern to video the controller has been seen to hang on USB
    console.write(c.INPUT_SOURCE, Input(Source.PARALLEL))
    console.set_mode(Mode.VIDEO)
    console.write(c.INPUT_SOURCE, Input(Source.PARALLEL, Width.BITS_24))
    console.write(c.PIXEL_FORMAT, PixelFormat.RGB444)
    console.write(c.CHANNEL_SWAP, channel_swap)
    deadline = time.monotonic() + lock_s
    while not _fits(signal := console.read(c.VIDEO_SIGNAL)) and time.monotonic() < deadline:
        time.sleep(console.configuration.pacing_s)
    return signal


def show_video(
    console: Console,
    depth: Depth,
    leds: LedSelect = LedSelect.WHITE,
    *,
    patterns: int | None = None,
    brightness: float = 1.0,
    channel_swap: int = CHANNEL_SWAP,
    lock_s: float = LOCK_S,
) -> VideoSignal:
    """Show the patterns of each frame of the video input until ``end_video``; returns the signal.

    A frame that is drawn in frame k of the input is seen in frame k + 2. patterns: of each frame, None for as many as
    fit. brightness: share of the LEDs' limits. Raises DeviceConfigurationError where no signal of 912x1140 comes within
    ``lock_s``, SequenceInvalidError for too many patterns or a sequence that the controller refuses, ProtocolError
    where it does not start; the projector is dark then.
    """
    program = video_program(depth, leds, patterns)
    try:
        signal = measure_signal(console, channel_swap=channel_swap, lock_s=lock_s)
        if not _fits(signal):
            raise _misfit(signal)
        console.set_mode(Mode.PATTERN)
        console.set_leds(brightness)
        if warnings := console.upload(program) & ~Validation.TRIGGER_CONTINUOUS:
            _LOG.warning("%s: warns of the video sequence: %s", NAME, words(warnings))
        console.start(math.inf)
    except DriverError:
        with suppress(DriverError):
            console.go_dark()
        raise
    return signal


def check_video(console: Console) -> None:
    """Raises ProtocolError where the frames are not shown any more, DeviceLostError where nobody answers.

    The signal itself cannot be asked for: the controller reports none in pattern mode.
    """
    if MainStatus.RUNNING not in console.read(c.MAIN_STATUS):
        why = words(console.read(c.HARDWARE_STATUS))
        raise ProtocolError(
            NAME,
            f"shows the video frames no longer{f' ({why})' if why else ''}; look whether its video input still gets "
            f"{_COLUMNS}x{_ROWS} at 60 Hz, and start again",
        )


def end_video(console: Console) -> None:
    """Stop and go dark: the projector stays in pattern mode, which shows nothing by itself."""
    console.go_dark()


def _fits(signal: VideoSignal) -> bool:
    return signal.locked and (signal.columns, signal.rows) == (_COLUMNS, _ROWS)


def _misfit(signal: VideoSignal) -> DeviceConfigurationError:
    measured = f"the controller measures {signal.columns}x{signal.rows}" if signal.locked else "it has locked to none"
    advice = f"set the output of the graphics card to exactly {_COLUMNS}x{_ROWS} at 60 Hz, without scaling"
    return DeviceConfigurationError(NAME, "video signal", "shown", f"{measured}; {advice}")
