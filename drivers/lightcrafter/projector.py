"""The LightCrafter 4500 as a projector of a rig."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStateError,
    DriverError,
    ProtocolError,
    SequenceInvalidError,
)
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.commands import NAME
from drivers.lightcrafter.console import Console
from drivers.lightcrafter.manifest import FlashManifest, StoredPattern
from drivers.lightcrafter.sequence import Program, compile_plan, find_stored, hold_program
from drivers.lightcrafter.settings import LightCrafterConfiguration
from drivers.lightcrafter.transport import Transport
from drivers.lightcrafter.values import LedSelect, MainStatus, Power, words
from drivers.projector import (
    LoadedSequence,
    ProjectorInfo,
    ProjectorLimits,
    ProjectorSettings,
    ProjectorState,
)
from models.patterns import MINIMUM_8BIT_EXPOSURE_US, Pattern, PatternPlan

_LOG = logging.getLogger(__name__)
_IDLE = (ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING)
_BRIGHTEST = 1.0


class LightCrafter:
    """Implements Projector over a transport.

    The controller shows each pattern of a sequence for the same time, and only patterns of the manifest. While a
    sequence runs ``state`` asks the controller whether it still does.
    """

    def __init__(self, transport: Transport, manifest: FlashManifest, configuration: LightCrafterConfiguration) -> None:
        self._transport = transport
        self._manifest = manifest
        self._configuration = configuration
        self._console = Console(transport, configuration)
        self._leds = LedSelect[configuration.leds.upper()]
        self._lock = threading.RLock()
        self._state = ProjectorState.CLOSED
        self._info: ProjectorInfo | None = None
        self._sequence: tuple[Program, LoadedSequence] | None = None
        self._ready = False
        self._brightness = _BRIGHTEST
        self._only_led: int | None = None
        self._may_be_lit = False

    @property
    def name(self) -> str:
        return NAME

    @property
    def state(self) -> ProjectorState:
        if self._state is ProjectorState.PROJECTING:
            with self._lock:
                self._look_whether_it_runs()
        return self._state

    def _look_whether_it_runs(self) -> None:
        if self._state is ProjectorState.PROJECTING:
            # a loss has set the state, which is the answer
            with suppress(DriverError), self._watched():
                if MainStatus.RUNNING not in self._console.read(c.MAIN_STATUS):
                    self._state, self._may_be_lit = ProjectorState.LOADED, False

    def open(self) -> ProjectorInfo:
        with self._lock:
            if self._state is not ProjectorState.CLOSED:
                raise self._wrong_state("be opened")
            self._transport.open()
            try:
                info = self._make_ready()
            except DeviceLostError as error:
                self._transport.close()
                raise DeviceNotFoundError(NAME, str(error).removeprefix(f"{NAME}: ")) from error
            except DriverError:
                self._transport.close()
                raise
            self._info, self._sequence, self._ready = info, None, False
            self._state = ProjectorState.OPEN
            return info

    def _make_ready(self) -> ProjectorInfo:
        versions = self._console.wake()
        self._only_led, self._may_be_lit = None, False
        self._console.go_dark()
        self._console.set_board()
        self._brightness = self._console.set_leds(_BRIGHTEST)
        there = self._console.read(c.FLASH_IMAGES)
        if there < self._manifest.images:
            raise DeviceConfigurationError(
                NAME,
                "manifest",
                f"of {self._manifest.images} flash images",
                f"the flash holds {there}; write the firmware that belongs to the manifest",
            )
        configuration = self._configuration
        limits = ProjectorLimits(
            exposure_us=(float(MINIMUM_8BIT_EXPOSURE_US), float(configuration.longest_us)),
            dark_us=float(configuration.dark_us),
        )
        return ProjectorInfo(
            driver="lightcrafter",
            model="LightCrafter 4500",
            serial=self._transport.location,
            firmware=str(versions.application),
            origin="simulated" if self._console.is_emulated() else "real",
            raster=self._manifest.raster,
            limits=limits,
            stored=self._manifest.plan,
        )

    @property
    def info(self) -> ProjectorInfo:
        if self._state is ProjectorState.CLOSED or self._info is None:
            raise DeviceStateError(NAME, "cannot tell what it is while it is closed")
        return self._info

    @property
    def configuration(self) -> LightCrafterConfiguration:
        return self._configuration

    @property
    def manifest(self) -> FlashManifest:
        """What the flash is believed to hold."""
        return self._manifest

    @contextmanager
    def asked(self) -> Iterator[Console]:
        """The procedures of an open projector that shows nothing, for questions beyond the protocol.

        Raises DeviceStateError in any other state, DeviceLostError where it is gone.
        """
        with self._lock:
            self._require("be asked", ProjectorState.OPEN, ProjectorState.LOADED)
            with self._watched():
                yield self._console

    def configure(self, settings: ProjectorSettings) -> ProjectorSettings:
        with self._lock:
            self._require("be configured", *_IDLE)
            with self._watched():
                self._brightness = self._console.set_leds(settings.brightness, self._only_led)
            return ProjectorSettings(brightness=self._brightness)

    def load(self, plan: PatternPlan, period_us: float) -> LoadedSequence:
        with self._lock:
            self._require("load a sequence", *_IDLE)
            self._console.begin()
            info = self.info
            with self._watched():
                # refused before anything is touched; loads are measured in the dark
                compile_plan(plan, period_us, self._manifest, info, lambda _: 0.0)
                self._end_holding()
                self._sequence, self._state = None, ProjectorState.OPEN
                program, loaded = compile_plan(plan, period_us, self._manifest, info, self._console.load_us, self._leds)
                self._upload(program)
            self._sequence, self._ready = (program, loaded), True
            self._state = ProjectorState.LOADED
            return loaded

    def _upload(self, program: Program) -> None:
        warnings = self._console.upload(program)
        if warnings:
            _LOG.warning("%s: warns of the sequence: %s", NAME, words(warnings))

    def start(self) -> None:
        with self._lock:
            self._require("start", ProjectorState.LOADED)
            self._console.begin()
            assert self._sequence is not None  # so it is in LOADED
            program, loaded = self._sequence
            with self._watched():
                # the controller forgets a sequence that was stopped or has ended
                if not self._ready:
                    self._upload(program)
                self._ready = False
                self._light(lambda: self._console.start(loaded.duration_us))
                self._state = ProjectorState.PROJECTING

    def check(self) -> None:
        with self._lock:
            if self._state is ProjectorState.FAULT:
                raise self._wrong_state("show that it is there")
            if self._state is not ProjectorState.CLOSED:
                with self._watched():
                    self._require_awake()

    def show(self, pattern: Pattern | None) -> None:
        with self._lock:
            self._require("hold a pattern", *_IDLE)
            self._console.begin()
            if pattern is None:
                with self._watched():
                    self._end_holding()
                return
            stored = find_stored(pattern, self._manifest)
            hold = self._by_video(stored) if self._configuration.hold == "video" else self._by_sequence(stored, pattern)
            with self._watched():
                self._end_holding()
                self._sequence, self._ready, self._state = None, False, ProjectorState.OPEN
                self._light(hold)
            self._state = ProjectorState.HOLDING

    def _light(self, begin: Callable[[], None]) -> None:
        """Begin to show something; where that is refused it may have begun all the same, and is ended."""
        self._may_be_lit = True
        try:
            begin()
        except (ProtocolError, SequenceInvalidError):
            with suppress(DriverError):
                self._go_dark()
            raise

    def _by_sequence(self, stored: StoredPattern, pattern: Pattern) -> Callable[[], None]:
        program = hold_program(stored, math.ceil(pattern.exposure_us or 0), self._leds)

        def hold() -> None:
            self._console.upload(program)  # it warns of the trigger output, which is known
            self._console.start(math.inf)

        return hold

    def _by_video(self, stored: StoredPattern) -> Callable[[], None]:
        kind = stored.pattern.kind
        if stored.depth != 8 and kind not in ("white", "black"):
            raise SequenceInvalidError(
                NAME, f"pattern '{stored.pattern.name}' is one bit of an image, which video mode cannot hold alone"
            )

        def hold() -> None:
            if kind == "white":
                self._console.show_still(None)
            elif kind != "black":
                self._only_led = stored.number
                self._console.set_leds(self._brightness, self._only_led)
                self._console.show_still(stored.image)

        return hold

    def stop(self) -> None:
        self._console.interrupt()
        with self._lock:
            if self._state is ProjectorState.PROJECTING:
                self._state = ProjectorState.LOADED
            elif self._state is ProjectorState.HOLDING:
                self._state = ProjectorState.OPEN
            self._end_light()

    def _end_light(self) -> None:
        """Once more where the first try is refused; a controller that is lost is asked once."""
        for _ in range(2):
            if not self._may_be_lit:
                return
            with suppress(DriverError), self._watched():
                self._go_dark()
            if self._state is ProjectorState.FAULT:
                return

    def close(self) -> None:
        self._console.interrupt()
        with self._lock:
            if self._state is not ProjectorState.CLOSED:
                self._end_light()
                if self._state is not ProjectorState.FAULT:
                    with suppress(DriverError):
                        self._console.go_dark()
            self._transport.close()
            self._state = ProjectorState.CLOSED
            self._sequence, self._ready = None, False

    def _end_holding(self) -> None:
        if self._state is ProjectorState.HOLDING:
            self._state = ProjectorState.OPEN
        if self._may_be_lit:
            self._go_dark()

    def _go_dark(self) -> None:
        self._console.go_dark()
        if self._only_led is not None:
            self._console.set_leds(self._brightness)
            self._only_led = None
        self._may_be_lit = False

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """A projector that is lost stays so until it is closed. One that refuses may have been sent to standby."""
        try:
            try:
                yield
            except ProtocolError:
                self._require_awake()
                raise
        except DeviceLostError:
            self._state = ProjectorState.FAULT
            raise

    def _require_awake(self) -> None:
        if self._console.read(c.POWER) is Power.STANDBY:
            raise DeviceLostError(NAME, "was sent to standby; close and open it again, which wakes it")

    def _require(self, purpose: str, *states: ProjectorState) -> None:
        if self.state is ProjectorState.FAULT:
            raise DeviceLostError(NAME, "does not answer any more; close and open it again")
        if self._state not in states:
            raise self._wrong_state(purpose)

    def _wrong_state(self, purpose: str) -> DriverError:
        if self._state is ProjectorState.FAULT:
            return DeviceLostError(NAME, "does not answer any more; close and open it again")
        return DeviceStateError(NAME, f"cannot {purpose} while it is {self._state}")
