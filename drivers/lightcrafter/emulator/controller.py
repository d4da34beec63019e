"""The controller's state and what each command does to it.

It is stricter than the real one where that helps: what the real one ignores or shows wrongly is refused, or shows in
the hardware status.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.errors import ProtocolError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import BY_USB, READ, WRITE, Command
from drivers.lightcrafter.console import EMULATED_TAG
from drivers.lightcrafter.emulator.faults import EmulatedFaults
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.emulator.light import emitted, led_drive
from drivers.lightcrafter.emulator.luts import Luts
from drivers.lightcrafter.emulator.player import Exposure, OnPulse, OnValid, exposures_of
from drivers.lightcrafter.emulator.registers import DEFAULTS, TICKS_PER_MS
from drivers.lightcrafter.emulator.sequencer import Sequencer
from drivers.lightcrafter.emulator.validation import validate
from drivers.lightcrafter.emulator.video import EmulatedVideo, plays_video
from drivers.lightcrafter.values import (
    Currents,
    HardwareStatus,
    LedSelect,
    LutEntry,
    Mailbox,
    MainStatus,
    Mode,
    Power,
    Release,
    Run,
    Validation,
    Versions,
)

_INVALIDATING = (c.DISPLAY_MODE, c.PATTERN_SOURCE, c.TRIGGER_MODE, c.TIMING, c.LUT_CONTROL)
_IN_STANDBY = (c.POWER, c.VERSION, c.HARDWARE_STATUS, c.MAIN_STATUS)


class RefusedError(Exception):
    """The controller does not accept the command."""


class SilentError(Exception):
    """The controller does not answer."""


class EmulatedController:
    """One DLPC350 with its LEDs inverted as on the EVM.

    on_pulse: called at each pulse of the trigger output, from the thread of the sequence, or from ``step``. on_valid:
    called with a sequence that passed validation, which lasts until it returns, on a thread of its own. Neither is
    called for one out of the video input, whose patterns follow each other without dark. video: that input.
    realtime: sequences run by themselves; else ``step`` shows one pattern after the other. two_image_quirk: two entries
    of the image LUT are read in exchanged order. entries, indexes: the pattern and the image LUT, as they were sent.
    """

    def __init__(
        self,
        flash: EmulatedFlash,
        *,
        on_pulse: OnPulse | None = None,
        on_valid: OnValid | None = None,
        realtime: bool = True,
        standby: bool = False,
        version: Release = Release(4, 4, 0),  # noqa: B008  (immutable)
        two_image_quirk: bool = True,
        validation_s: float = 0.03,
        wake_s: float = 0.2,
    ) -> None:
        self.faults = EmulatedFaults()
        self.flash = flash
        self.video = EmulatedVideo()
        self._on_valid = on_valid
        self._sequencer = Sequencer(on_pulse, self._end, realtime=realtime)
        self._version = version
        self._luts = Luts(two_image_quirk=two_image_quirk)
        self._validation_s, self._wake_s = validation_s, wake_s
        self._lock = threading.RLock()
        self._plugged = True
        self._on_unplug: list[Callable[[], None]] = []
        self._power_up(Power.STANDBY if standby else Power.NORMAL)

    def _power_up(self, power: Power) -> None:
        self._power = power
        self._awake_at = 0.0
        self._values: dict[Command[Any], Any] = dict(DEFAULTS)
        self._luts.clear()
        self._run = Run.STOP
        self._status = HardwareStatus.INITIALISED
        self._validation = Validation.PATTERN_INVALID
        self._validated_at = 0.0
        self._examining: threading.Thread | None = None
        self._valid = False
        self._load_range = (0, 0)

    @property
    def entries(self) -> dict[int, LutEntry]:
        return self._luts.entries

    @property
    def indexes(self) -> dict[int, int]:
        return self._luts.indexes

    @property
    def plugged(self) -> bool:
        """Whether it is on its bus."""
        return self._plugged

    @property
    def running(self) -> bool:
        return self._run is Run.START

    @property
    def showing(self) -> Exposure | None:
        """The pattern of a sequence that stands on the mirrors."""
        return self._sequencer.showing

    @property
    def pulses_sent(self) -> int:
        return self._sequencer.pulses_sent

    def on_unplug(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` when the controller loses its power."""
        self._on_unplug.append(listener)

    def unplug(self) -> None:
        """Lose the power: dark, no answer, every register forgotten."""
        self._sequencer.halt()
        with self._lock:
            self._plugged = False
            self._power_up(Power.NORMAL)
        for listener in self._on_unplug:
            listener()

    def plug(self) -> None:
        self._plugged = True

    def handle(self, code: int, payload: bytes | None, argument: bytes = b"") -> bytes:
        """Carry out one command; a read where ``payload`` is None, which takes no ``argument`` here.

        Raises RefusedError and SilentError.
        """
        if self.faults.delay_s:
            time.sleep(self.faults.delay_s)
        command = BY_USB.get((code, READ if payload is None else WRITE))
        if not self._plugged or time.monotonic() < self._awake_at or (command and command.name in self.faults.silent):
            raise SilentError
        if command is None or argument or command.name in self.faults.refused:
            raise RefusedError
        if self._power is Power.STANDBY and command not in _IN_STANDBY:
            raise RefusedError
        if command is c.RUN and payload is not None:
            return self._set_run(_decoded(command, payload))
        with self._lock:
            if payload is None:
                return command.encode(self._read(command))
            self._write(command, payload)
            return b""

    def _read(self, command: Command[Any]) -> Any:
        if command is c.VERSION:
            return Versions(self._version, Release(3, 1, 0), Release(2, 0, 0), Release(1, 0, 0))
        if command is c.FIRMWARE_TAG:
            return EMULATED_TAG
        if command is c.FLASH_IMAGES:
            return len(self.flash)
        if command is c.HARDWARE_STATUS:
            return HardwareStatus(self._status | self.faults.hardware)
        if command is c.MAIN_STATUS:
            return MainStatus.PARKED * (self._power is Power.STANDBY) | MainStatus.RUNNING * self.running
        if command is c.POWER:
            return self._power
        if command is c.RUN:
            return self._run
        if command is c.VALIDATE:
            return Validation.BUSY if self._is_validating() else self._validation
        if command is c.IMAGE_LOAD_TIME and self.faults.no_load_times:
            return 0
        if command is c.IMAGE_LOAD_TIME:
            first, count = self._load_range
            return round(sum(1e-3 * self.flash.load_us(first + k) for k in range(count)) * TICKS_PER_MS)
        if command is c.LED_CURRENT and self.faults.wrong_currents:
            return Currents(1, 2, 3)
        if command is c.VIDEO_SIGNAL:
            return self.video.status(self._values)
        if command not in self._values:
            raise RefusedError
        return self._values[command]

    def _write(self, command: Command[Any], payload: bytes) -> None:
        if command is c.PATTERN_ENTRIES:
            self._fill_mailbox(payload)
            return
        value = _decoded(command, payload)
        if command is c.POWER:
            self._set_power(value)
        elif command is c.VALIDATE:
            self._validate()
        elif command is c.IMAGE_LOAD_RANGE:
            first, count = value
            if first + count > len(self.flash):
                raise RefusedError
            self._load_range = (first, count)
        else:
            if self.running and command in _INVALIDATING:
                raise RefusedError
            if command is c.DISPLAY_MODE and self.faults.stuck_mode:
                return
            self._values[command] = value
            if command in _INVALIDATING:
                self._forget_luts()

    def _set_power(self, power: Power) -> None:
        if power is Power.NORMAL and self._power is Power.STANDBY:
            self._power_up(Power.NORMAL)
            self._awake_at = time.monotonic() + self._wake_s
            raise SilentError
        self._power = power

    def _forget_luts(self) -> None:
        self._luts.clear()
        self._valid = False

    def _fill_mailbox(self, payload: bytes) -> None:
        box, offset = self._values[c.MAILBOX_SELECT], self._values[c.MAILBOX_OFFSET]
        if box is Mailbox.CLOSED or self.running:
            raise RefusedError
        if box is Mailbox.PATTERNS:
            self._luts.add_entries(offset, _decoded(c.PATTERN_ENTRIES, payload))
        else:
            self._luts.add_indexes(offset, _decoded(c.IMAGE_INDEXES, payload))
        self._valid = False

    def _validate(self) -> None:
        entries, images = self._luts.selected(self._values[c.LUT_CONTROL])
        found = validate(entries, images, self._values, len(self.flash))
        self._validation = found | Validation(self.faults.validation)
        errors = self._validation & (Validation.EXPOSURE_INVALID | Validation.PATTERN_INVALID)
        self._valid = not errors and self._values[c.MAILBOX_SELECT] is Mailbox.CLOSED
        self._validated_at = time.monotonic() + self._validation_s
        if self._valid and self._on_valid is not None and not plays_video(self._values):
            exposures = exposures_of(entries, images, self._values[c.TIMING], self.flash)
            self._examining = threading.Thread(target=self._on_valid, args=(exposures,), daemon=True)
            self._examining.start()

    def _is_validating(self) -> bool:
        examined = self._examining is None or not self._examining.is_alive()
        return self.faults.stuck_validation or not examined or time.monotonic() < self._validated_at

    def _set_run(self, run: Run) -> bytes:
        if run is not Run.START:
            self._sequencer.halt()
            with self._lock:
                self._run = run
                if run is Run.STOP:
                    self._forget_luts()
            return b""
        with self._lock:
            if self.faults.deaf_starts:
                self.faults.deaf_starts -= 1
            elif not self.running:
                self._start()
            return b""

    def _start(self) -> None:
        in_mode, from_video = self._values[c.DISPLAY_MODE] is Mode.PATTERN, plays_video(self._values)
        if not in_mode or not self._valid or self._is_validating() or (from_video and not self.video.plays):
            self._status |= HardwareStatus.SEQUENCE_ERROR
            return
        timing, control = self._values[c.TIMING], self._values[c.LUT_CONTROL]
        self._status = HardwareStatus.INITIALISED
        entries, images = self._luts.selected(control)
        self._run = Run.START
        if from_video:
            self._sequencer.follow(partial(self.video.next_frame, entries, timing))
        else:
            self._sequencer.play(exposures_of(entries, images, timing, self.flash), timing, control)

    def step(self) -> Exposure | None:
        """Show the next pattern, without real time; None where the sequence has ended."""
        return self._sequencer.step()

    def _end(self) -> None:
        with self._lock:
            self._run = Run.STOP
            self._forget_luts()
            if plays_video(self._values):  # which ends by itself only where the signal is lost
                self._status |= HardwareStatus.SEQUENCE_ABORTED

    def led_shares(self, leds: LedSelect = LedSelect.WHITE) -> tuple[float, float, float]:
        """Drive of the red, green and blue LED under a pattern that these light, 0..1."""
        with self._lock:
            drive = led_drive(self._values)
        return tuple(float(d) * (int(leds) >> k & 1) for k, d in enumerate(drive))  # type: ignore[return-value]

    def light(self) -> npt.NDArray[np.float64]:
        """What the projector emits now: (rows, columns, 3) red, green, blue, 0..255."""
        alive = self._plugged and self._power is Power.NORMAL
        return emitted(self._values, self.showing, self.flash, self.video) * float(alive)


def _decoded(command: Command[Any], payload: bytes) -> Any:
    try:
        return command.decode(payload)
    except ProtocolError as error:
        raise RefusedError from error
