"""The controller's procedures: several commands each, in the order that its guide asks for."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceConfigurationError, DeviceLostError, DriverError, ProtocolError, SequenceInvalidError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.codecs import ENTRY_BYTES
from drivers.lightcrafter.commands import NAME, Command
from drivers.lightcrafter.sequence import Program
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.transport import Transport, read, write
from drivers.lightcrafter.values import (
    Currents,
    HardwareStatus,
    ImageRange,
    Input,
    InternalColour,
    InternalPattern,
    LedEnable,
    Mailbox,
    MainStatus,
    Mode,
    Power,
    Release,
    Run,
    Source,
    TriggerOutput,
    Validation,
    Versions,
    words,
)

_LOG = logging.getLogger(__name__)
T = TypeVar("T")
OLDEST_FIRMWARE = Release(3, 0, 0)
"""Older firmware takes numbers over I2C in another byte order and loses LUT entries."""
EMULATED_TAG = "emulated"
_TICKS_PER_US = 18.667
_UNKNOWN_LOAD_US = 200_000.0
"""Of an image that is not compressed."""
_REOPEN_S = 15.0
_FULL = 1023
_LED_OF_CHANNEL = (1, 0, 2)
"""Red, green, blue LED (0, 1, 2) of the green, red, blue byte of an image."""
_UNDELAYED = 0xBB
_DELAY_STEP_US = 0.1072


class Console:
    """Procedures on an open transport. Every call raises DeviceLostError and ProtocolError as the transport does."""

    def __init__(self, transport: Transport, configuration: LightCrafterConfiguration) -> None:
        self._transport = transport
        self._configuration = configuration
        self._loads_us: dict[int, float] = {}
        self._interrupted = threading.Event()

    def interrupt(self) -> None:
        """End a validation that another thread waits for, or is about to."""
        self._interrupted.set()

    def begin(self) -> None:
        """What was interrupted before does not count for what comes now."""
        self._interrupted.clear()

    @property
    def configuration(self) -> LightCrafterConfiguration:
        return self._configuration

    def read(self, command: Command[T]) -> T:
        return read(self._transport, command)

    def write(self, command: Command[T], value: T) -> None:
        write(self._transport, command, value)

    def wake(self) -> Versions:
        """Have it awake, of a known version and without a fault. Raises DeviceConfigurationError for old firmware."""
        versions = self.read(c.VERSION)
        if versions.application < OLDEST_FIRMWARE:
            advice = f"{OLDEST_FIRMWARE} is the oldest that works; update it with TI's GUI"
            raise DeviceConfigurationError(NAME, "firmware", versions.application, advice)
        if self.read(c.POWER) is Power.STANDBY:
            self._leave_standby()
        self._loads_us.clear()
        status = self.read(c.HARDWARE_STATUS)
        if HardwareStatus.INITIALISED not in status or HardwareStatus.DMD_RESET_ERROR in status:
            raise ProtocolError(NAME, f"is not ready: {words(status) or 'it did not initialise'}; switch it off and on")
        return versions

    def _leave_standby(self) -> None:
        """The controller may forget to answer, and may leave the bus for a while."""
        try:
            self.write(c.POWER, Power.NORMAL)
        except DeviceLostError:
            self._transport.close()
        deadline = time.monotonic() + self._configuration.wake_s + _REOPEN_S
        time.sleep(self._configuration.wake_s)
        while not self._is_awake():
            if time.monotonic() > deadline:
                raise DeviceLostError(NAME, "does not wake from standby; switch it off and on")
            time.sleep(max(0.05, self._configuration.pacing_s))

    def _is_awake(self) -> bool:
        try:
            self._transport.open()
            return self.read(c.POWER) is Power.NORMAL
        except DriverError:
            self._transport.close()
            return False

    def is_emulated(self) -> bool:
        """Whether a program stands in for the controller, which says so itself."""
        try:
            return self.read(c.FIRMWARE_TAG) == EMULATED_TAG
        except ProtocolError:
            return False  # not every firmware has a tag

    def go_dark(self) -> None:
        """Stop whatever runs and stay in pattern mode, which shows nothing by itself."""
        self.halt()
        if self.read(c.DISPLAY_MODE) is not Mode.PATTERN:
            self.set_mode(Mode.PATTERN)

    def set_board(self) -> None:
        """Flips and trigger output, as far as the settings name them; nothing may be shown meanwhile.

        Raises DeviceConfigurationError where a flip reads back otherwise.
        """
        configuration = self._configuration
        for command, flip in ((c.FLIP_LONG, configuration.flip_long), (c.FLIP_SHORT, configuration.flip_short)):
            if flip is not None:
                self.write(command, int(flip))
                if (got := self.read(command)) != flip:
                    raise DeviceConfigurationError(NAME, command.name, int(flip), f"it reads back as {got}")
        polarity, delays_us = configuration.trigger_out_polarity, configuration.trigger_out_delays_us
        if polarity is not None or delays_us is not None:
            rise, fall = (_UNDELAYED + round(delay / _DELAY_STEP_US) for delay in delays_us or (0.0, 0.0))
            self.write(c.TRIGGER_OUTPUT, TriggerOutput(polarity or 0, rise, fall))

    def halt(self) -> None:
        """Stop the sequence and see it stopped."""
        self.write(c.RUN, Run.STOP)
        self._reach(
            lambda: self.read(c.RUN) is Run.STOP and MainStatus.RUNNING not in self.read(c.MAIN_STATUS),
            "does not stop its sequence",
            lambda: self.write(c.RUN, Run.STOP),
        )

    def set_mode(self, mode: Mode) -> None:
        """Change the display mode and see it changed; the LUTs are lost."""
        self.write(c.DISPLAY_MODE, mode)
        self._reach(lambda: self.read(c.DISPLAY_MODE) is mode, f"does not enter its {mode.name.lower()} mode")

    def set_leds(self, brightness: float, only: int | None = None) -> float:
        """Drive the LEDs with a share of their limits; returns the share that reads back.

        only: which of green, red, blue (0, 1, 2) is driven while the others stay dark; None drives all. Raises
        DeviceConfigurationError where the currents read back otherwise.
        """
        lit = (0, 1, 2) if only is None else (_LED_OF_CHANNEL[only],)
        limits = self._configuration.led_limits
        shares = (round(brightness * limit) if led in lit else 0 for led, limit in enumerate(limits))
        currents = Currents._make(map(self._drive, shares))
        self.write(c.LED_POLARITY, self._configuration.led_polarity)
        self.write(c.LED_ENABLE, LedEnable.SEQUENCER)
        self.write(c.LED_CURRENT, currents)
        got = self.read(c.LED_CURRENT)
        if got != currents:
            raise DeviceConfigurationError(NAME, "LED current", tuple(currents), f"it reads back as {tuple(got)}")
        finest = max(lit, key=limits.__getitem__)
        return self._drive(got[finest]) / limits[finest]

    def _drive(self, value: int) -> int:
        """Byte on the wire of a drive 0..255, and back."""
        return 255 - value if self._configuration.led_inverted else value

    def load_us(self, image: int) -> float:
        """How long a flash image takes to come into the buffer, as it is set, or as the controller measures it.

        Measures only while nothing is shown.
        """
        if self._configuration.image_load_us is not None:
            return self._configuration.image_load_us
        if image not in self._loads_us:
            self._loads_us[image] = self._measured_load_us(image)
        return self._loads_us[image]

    def _measured_load_us(self, image: int) -> float:
        """The longest that is known of any image where the controller does not tell."""
        if not self._transport.carries(c.IMAGE_LOAD_TIME):
            return _UNKNOWN_LOAD_US
        try:
            self.write(c.IMAGE_LOAD_RANGE, ImageRange(image, 1))
            deadline = time.monotonic() + self._configuration.settle_s
            while not (ticks := self.read(c.IMAGE_LOAD_TIME)) and time.monotonic() < deadline:
                time.sleep(self._configuration.pacing_s)
        except ProtocolError as error:
            _LOG.warning("%s; taking %g us for the load of each image", error, _UNKNOWN_LOAD_US)
            return _UNKNOWN_LOAD_US
        return ticks / _TICKS_PER_US if ticks else _UNKNOWN_LOAD_US

    def upload(self, program: Program) -> Validation:
        """Send a sequence and validate it; returns the warnings. Whatever ran before is stopped.

        Raises SequenceInvalidError where validation fails.
        """
        if MainStatus.RUNNING in self.read(c.MAIN_STATUS):
            self.halt()
        if self.read(c.DISPLAY_MODE) is not Mode.PATTERN:
            self.set_mode(Mode.PATTERN)
        self.write(c.PATTERN_SOURCE, program.source)
        self.write(c.LUT_CONTROL, program.control)
        self.write(c.TIMING, program.timing)
        self.write(c.TRIGGER_MODE, program.trigger_mode)
        images = program.images
        if len(images) == 2 and self._configuration.swap_two_images:
            images = images[::-1]
        self._fill(Mailbox.PATTERNS, c.PATTERN_ENTRIES, program.entries, ENTRY_BYTES)
        if images:
            self._fill(Mailbox.IMAGES, c.IMAGE_INDEXES, images, 1)
        return self._validate()

    def _fill(self, box: Mailbox, command: Command[tuple[T, ...]], values: tuple[T, ...], size: int) -> None:
        at_once = max(1, self._transport.largest_payload // size)
        self.write(c.MAILBOX_SELECT, box)
        for start in range(0, len(values), at_once):
            self.write(c.MAILBOX_OFFSET, start)
            self.write(command, values[start : start + at_once])
        self.write(c.MAILBOX_SELECT, Mailbox.CLOSED)

    def _validate(self) -> Validation:
        self.write(c.VALIDATE, Validation(0))
        time.sleep(self._configuration.validate_first_s)
        deadline = time.monotonic() + self._configuration.validate_s
        while (found := self.read(c.VALIDATE)) & Validation.BUSY:
            if self._interrupted.is_set():
                raise ProtocolError(NAME, "was stopped while it validated the sequence")
            if time.monotonic() > deadline:
                raise ProtocolError(NAME, f"did not finish validation within {self._configuration.validate_s:g} s")
            time.sleep(self._configuration.pacing_s)
        if found & (Validation.EXPOSURE_INVALID | Validation.PATTERN_INVALID):
            raise SequenceInvalidError(NAME, f"refuses the sequence: {words(found)}")
        return found

    def start(self, duration_us: float) -> None:
        """Start the sequence that was validated. duration_us: how long it runs, infinite where it repeats.

        Not to see it running means that it did not start only while it cannot have ended yet; so a short one is never
        started twice.
        """
        old = self.read(c.HARDWARE_STATUS)
        self.write(c.RUN, Run.START)
        for attempt in range(2):
            asked_at = time.monotonic()
            while MainStatus.RUNNING not in self.read(c.MAIN_STATUS):
                waited_s = time.monotonic() - asked_at
                status = self.read(c.HARDWARE_STATUS) & ~old
                if status & (HardwareStatus.SEQUENCE_ERROR | HardwareStatus.SEQUENCE_ABORTED):
                    raise ProtocolError(NAME, f"did not start the sequence: {words(status)}")
                if waited_s > self._configuration.settle_s or waited_s > 1e-6 * duration_us:
                    break
                time.sleep(self._configuration.pacing_s)
            else:
                return
            if 1e-6 * duration_us <= self._configuration.settle_s:
                return
            if attempt == 0:
                self.write(c.RUN, Run.START)
        raise ProtocolError(NAME, "acknowledged the start of the sequence and shows nothing")

    def show_still(self, image: int | None) -> None:
        """Show a flash image in video mode, or white where it is None. Pattern mode is left."""
        self.halt()
        self.write(c.GAMMA, 0)
        if image is None:
            self.write(c.TEST_PATTERN, InternalPattern.SOLID)
            self.write(c.TEST_COLOUR, InternalColour(_FULL, _FULL, _FULL, 0, 0, 0))
            self.write(c.INPUT_SOURCE, Input(Source.TEST_PATTERN))
        else:
            self.write(c.STILL_IMAGE, image)
            self.write(c.INPUT_SOURCE, Input(Source.FLASH))
        self.set_mode(Mode.VIDEO)

    def _reach(self, reached: Callable[[], bool], failure: str, again: Callable[[], None] | None = None) -> None:
        deadline = time.monotonic() + self._configuration.settle_s
        while not reached():
            if time.monotonic() > deadline:
                raise ProtocolError(NAME, failure)
            time.sleep(self._configuration.pacing_s)
            if again is not None:
                again()
