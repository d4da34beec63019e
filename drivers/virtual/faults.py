"""Faults that a virtual rig is asked to have, so that what notices them can be tried."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, get_args

from models.geometry.rig import SIDES, Side

FaultKind = Literal[
    "dropped",
    "ignored",
    "late",
    "doubled",
    "swapped",
    "truncated",
    "dead_camera",
    "drifted",
    "moved",
    "saturated",
    "dark",
    "early",
    "not_started",
    "start_refused",
    "unplugged",
]


@dataclass(frozen=True)
class PlantedFault:
    """One fault.

    kind, where "index" counts the pulses of a sequence from 0:
      dropped        the frame of ``index`` is lost in transfer: the next frame id jumps
      ignored        the camera does not see pulse ``index``: ids go on, the gap is two periods
      late           the frame of ``index``, and all behind it, arrive ``delay_s`` after their time
      doubled        one pulse too many right after ``index``
      swapped        the images of ``index`` and the next are exchanged; in both views: the projector's order is wrong
      truncated      the frame of ``index`` comes damaged
      dead_camera    from ``index`` on the camera answers nothing until it is closed and opened again
      drifted        from ``index`` on the camera holds another exposure time than it was given
      moved          from ``index`` on the view is shifted by ``shift_px`` pixels
      saturated      from ``index`` on the view reads its white level wherever there is any light
      dark           from ``index`` on the lamp is out
      early          a pulse reaches the camera as soon as it is armed
      not_started    the projector says that it started and sends nothing
      start_refused  the projector refuses to start
      unplugged      the projector is gone when a sequence is loaded or started
    side: which camera; None for both. sequences: how many sequences in a row have it, None for ever.
    """

    kind: FaultKind
    side: Side | None = None
    index: int = 0
    sequences: int | None = 1
    delay_s: float = 0.4
    shift_px: int = 6

    def __post_init__(self) -> None:
        if self.kind not in get_args(FaultKind):
            raise ValueError(f"fault '{self.kind}' is unknown; known are {', '.join(get_args(FaultKind))}")
        if self.index < 0 or (self.sequences is not None and self.sequences < 1):
            raise ValueError(f"fault '{self.kind}': index counts from 0 and sequences from 1")

    @property
    def sides(self) -> tuple[Side, ...]:
        return SIDES if self.side is None else (self.side,)


@dataclass(frozen=True)
class SequenceFaults:
    """The faults of one sequence."""

    faults: tuple[PlantedFault, ...] = ()

    def has(self, kind: FaultKind) -> bool:
        return any(f.kind == kind for f in self.faults)

    def at(self, kind: FaultKind, side: Side, index: int) -> PlantedFault | None:
        """The fault that strikes at exactly this pulse."""
        return next((f for f in self.faults if f.kind == kind and side in f.sides and f.index == index), None)

    def since(self, kind: FaultKind, side: Side, index: int) -> PlantedFault | None:
        """The fault that has lasted since this pulse or an earlier one."""
        return next((f for f in self.faults if f.kind == kind and side in f.sides and f.index <= index), None)

    def order(self, side: Side, length: int) -> list[int]:
        """Which pattern's image each pulse gives."""
        order = list(range(length))
        for fault in self.faults:
            if fault.kind == "swapped" and side in fault.sides and fault.index + 1 < length:
                first = fault.index
                order[first], order[first + 1] = order[first + 1], order[first]
        return order


@dataclass(eq=False)
class _Entry:
    fault: PlantedFault
    left: int | None
    struck: set[Side] = field(default_factory=set)


class Faults:
    """Faults that are still to come; may be planted and cleared from any thread."""

    _outside_sequences: tuple[FaultKind, ...] = ("early", "start_refused", "unplugged")

    def __init__(self, faults: Iterable[PlantedFault] = ()) -> None:
        self._lock = threading.Lock()
        self._entries: list[_Entry] = []
        for fault in faults:
            self.plant(fault)

    @property
    def planted(self) -> tuple[PlantedFault, ...]:
        with self._lock:
            return tuple(e.fault for e in self._entries)

    def plant(self, fault: PlantedFault) -> None:
        with self._lock:
            self._entries.append(_Entry(fault, fault.sequences))

    def clear(self) -> None:
        with self._lock:
            self._entries.clear()

    def begin_sequence(self) -> SequenceFaults:
        """What the sequence that starts now suffers; uses up one sequence of each."""
        with self._lock:
            active = [e for e in self._entries if e.fault.kind not in self._outside_sequences]
            for entry in active:
                self._use_up(entry)
            return SequenceFaults(tuple(e.fault for e in active))

    def spend(self, kind: FaultKind, side: Side | None = None) -> PlantedFault | None:
        """Use up one sequence of the first fault of this kind and return it, None where there is none."""
        with self._lock:
            entry = self._find(kind, side)
            if entry is None:
                return None
            self._use_up(entry)
            return entry.fault

    def strike(self, kind: FaultKind, side: Side) -> PlantedFault | None:
        """As ``spend``, but a fault of both cameras is used up when it has struck both."""
        with self._lock:
            entry = self._find(kind, side)
            if entry is None:
                return None
            entry.struck.add(side)
            if entry.struck.issuperset(entry.fault.sides):
                entry.struck.clear()
                self._use_up(entry)
            return entry.fault

    def _find(self, kind: FaultKind, side: Side | None) -> _Entry | None:
        fits = (e for e in self._entries if e.fault.kind == kind and (side is None or side in e.fault.sides))
        return next(fits, None)

    def _use_up(self, entry: _Entry) -> None:
        if entry.left is not None:
            entry.left -= 1
            if entry.left == 0:
                self._entries.remove(entry)
