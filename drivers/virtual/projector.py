"""A projector that lights a scene source."""

from __future__ import annotations

import threading
import time

from drivers.errors import (
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStateError,
    ProtocolError,
    SequenceInvalidError,
)
from drivers.projector import (
    LoadedSequence,
    ProjectorInfo,
    ProjectorSettings,
    ProjectorState,
)
from drivers.sequence_rules import NAME, check_plan, unstored
from drivers.virtual.bench import Bench
from drivers.virtual.faults import SequenceFaults
from models.patterns import Pattern, PatternPlan

_LEAD_US = 5000.0
"""From ``start`` to the first pulse."""


class VirtualProjector:
    """Implements Projector. In real time a thread of its own sends the pulses; it ends with the sequence.

    Without real time ``start`` sends all pulses before it returns.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._lock = threading.RLock()
        self._state = ProjectorState.CLOSED
        self._lost = False
        self._plugged = True
        self._halt = threading.Event()
        self._player: threading.Thread | None = None

    @property
    def bench(self) -> Bench:
        """Where faults are planted."""
        return self._bench

    @property
    def name(self) -> str:
        return NAME

    @property
    def state(self) -> ProjectorState:
        return self._state

    def open(self) -> ProjectorInfo:
        with self._lock:
            if self._state is not ProjectorState.CLOSED:
                raise DeviceStateError(NAME, f"cannot be opened while it is {self._state}")
            if not self._plugged or (self._lost and self._bench.faults.spend("unplugged")):
                raise DeviceNotFoundError(NAME, "does not answer; check its cable and power")
            info = self._bench.source.projector_info
            self._lost = False
            self._bench.brightness = 1.0
            self._go_dark()
            self._state = ProjectorState.OPEN
            return info

    @property
    def info(self) -> ProjectorInfo:
        if self._state is ProjectorState.CLOSED:
            raise DeviceStateError(NAME, "cannot tell what it is while it is closed")
        return self._bench.source.projector_info

    def configure(self, settings: ProjectorSettings) -> ProjectorSettings:
        with self._lock:
            self._require_idle("be configured")
            self._bench.brightness = settings.brightness
            return settings

    def load(self, plan: PatternPlan, period_us: float) -> LoadedSequence:
        with self._lock:
            self._require_idle("load a sequence")
            self._be_unplugged()
            sequence = check_plan(plan, period_us, self._bench.source.projector_info)
        # not under the lock: it may last, and ``close`` must not wait for it
        self._bench.source.prepare(plan)
        with self._lock:
            self._require_idle("load a sequence")
            self._bench.shown = None
            self._bench.sequence = sequence
            self._state = ProjectorState.LOADED
        self._bench.get_ready()
        return sequence

    def start(self) -> None:
        self._bench.get_ready()
        with self._lock:
            self._require("start", ProjectorState.LOADED)
            self._be_unplugged()
            if self._bench.faults.spend("start_refused"):
                raise ProtocolError(NAME, "refused to start the sequence")
            sequence = self._bench.sequence
            assert sequence is not None
            missing = unstored(sequence.plan, self._bench.source.projector_info.stored)
            if missing is not None:
                raise SequenceInvalidError(NAME, f"pattern '{missing.name}' is not stored for the present scene")
            faults = self._bench.faults.begin_sequence()
            self._state = ProjectorState.PROJECTING
            self._halt = threading.Event()
            arguments = (sequence, faults, self._bench.time.now_us() + _LEAD_US, self._halt)
            if self._bench.time.realtime:
                self._player = threading.Thread(
                    target=self._play, args=arguments, name="virtual projector", daemon=True
                )
                self._player.start()
        if not self._bench.time.realtime:
            self._play(*arguments)

    def _play(self, sequence: LoadedSequence, faults: SequenceFaults, begin_us: float, halt: threading.Event) -> None:
        silent = faults.has("not_started")
        for index, pulse_us in enumerate(sequence.pulses_us):
            if self._halted_before(begin_us + pulse_us, halt):
                return
            if not silent:
                self._bench.send_pulse(index, begin_us + pulse_us, faults)
        if not self._halted_before(begin_us + sequence.duration_us, halt):
            with self._lock:
                if not halt.is_set():
                    self._state = ProjectorState.LOADED

    def _halted_before(self, at_us: float, halt: threading.Event) -> bool:
        self._bench.time.reach(at_us)
        return halt.wait(max(0.0, self._bench.time.comes_s(at_us) - time.monotonic()))

    def check(self) -> None:
        with self._lock:
            if self._state is ProjectorState.FAULT:
                raise self._lost_error()

    def show(self, pattern: Pattern | None) -> None:
        with self._lock:
            self._require_idle("hold a pattern")
            if pattern is None:
                self._stop_holding()
                return
            if unstored(PatternPlan(patterns=(pattern,)), self._bench.source.projector_info.stored) is not None:
                raise SequenceInvalidError(NAME, f"pattern '{pattern.name}' is not stored with these parameters")
            self._bench.sequence = None
            self._bench.shown = pattern
            self._state = ProjectorState.HOLDING

    def stop(self) -> None:
        player = self._end_sequence()
        if player is not None:
            player.join()

    def close(self) -> None:
        player = self._end_sequence()
        with self._lock:
            self._go_dark()
            self._state = ProjectorState.CLOSED
        if player is not None:
            player.join()

    def unplug(self) -> None:
        """Be gone until ``plug``."""
        player = self._end_sequence()
        with self._lock:
            self._plugged = False
            if self._state is not ProjectorState.CLOSED:
                self._go_dark()
                self._state = ProjectorState.FAULT
        if player is not None:
            player.join()

    def plug(self) -> None:
        """Be there again; a projector that was open must be closed and opened."""
        self._plugged = True

    def _end_sequence(self) -> threading.Thread | None:
        """Send no more pulses; returns the thread that is to be joined, outside the lock that it may want."""
        with self._lock:
            self._halt.set()
            self._stop_holding()
            if self._state is ProjectorState.PROJECTING:
                self._state = ProjectorState.LOADED
            player, self._player = self._player, None
            return player

    def _stop_holding(self) -> None:
        if self._state is ProjectorState.HOLDING:
            self._bench.shown = None
            self._state = ProjectorState.OPEN

    def _go_dark(self) -> None:
        self._bench.shown = None
        self._bench.sequence = None

    def _be_unplugged(self) -> None:
        if self._bench.faults.spend("unplugged"):
            self._lost = True
            self._go_dark()
            self._state = ProjectorState.FAULT
            raise self._lost_error()

    def _require_idle(self, purpose: str) -> None:
        self._require(purpose, ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING)

    def _require(self, purpose: str, *states: ProjectorState) -> None:
        if self._state is ProjectorState.FAULT:
            raise self._lost_error()
        if self._state not in states:
            raise DeviceStateError(NAME, f"cannot {purpose} while it is {self._state}")

    def _lost_error(self) -> DeviceLostError:
        return DeviceLostError(NAME, "does not answer any more; close and open it again")
