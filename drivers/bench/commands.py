"""What can be said to a bench while it runs: one line, one thing to go wrong or to be mended."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

from drivers.bench.bench import VirtualBench
from drivers.errors import DriverError
from drivers.lightcrafter.commands import TABLE
from drivers.virtual.faults import FaultKind, PlantedFault
from models.geometry.rig import SIDES, Side

HELP = """fault KIND [left|right|both] [EXPOSURE] [always]   have a fault in the next sequence, or in all
invert SIDE      the camera's trigger line is low while a pattern is lit
cut SIDE         the camera's trigger line is cut
unplug DEVICE    left, right or projector; plug DEVICE brings it back
refuse COMMAND   the projector refuses a command, named as in its table; silence COMMAND: it does not answer it
stuck            validation in the projector never ends; stale: answers to nobody come before its own (USB)
standby          send the projector to sleep
scene N          stand before another simulated scene
mend             undo all of this; status tells what is wrong; help
kinds of faults: """ + ", ".join(get_args(FaultKind))
_STALE = 2


class BenchCommands:
    """Carries out lines of text on a bench."""

    def __init__(self, bench: VirtualBench) -> None:
        self._bench = bench
        self._words: dict[str, Callable[[list[str]], str]] = {
            "fault": self._fault,
            "invert": lambda rest: self._wire(bench.wiring.inverted, rest),
            "cut": lambda rest: self._wire(bench.wiring.cut, rest),
            "unplug": lambda rest: self._plug(rest, there=False),
            "plug": lambda rest: self._plug(rest, there=True),
            "refuse": lambda rest: self._mark(bench.projector.faults.refused, rest),
            "silence": lambda rest: self._mark(bench.projector.faults.silent, rest),
            "stuck": self._stuck,
            "stale": self._stale,
            "standby": self._standby,
            "scene": self._scene,
            "mend": self._mend,
            "status": self._status,
            "help": lambda _: HELP,
        }

    def obey(self, line: str) -> str:
        """What was done, in a line or more. Raises ValueError that says what is wrong with the line."""
        first, *rest = line.split() or ["help"]
        if first not in self._words:
            raise ValueError(f"'{first}' is no command; known are {', '.join(self._words)}")
        return self._words[first](rest)

    def _fault(self, words: list[str]) -> str:
        kinds = [kind for kind in get_args(FaultKind) if words and kind == words[0]]
        if not kinds:
            raise ValueError(f"a fault is one of {', '.join(get_args(FaultKind))}")
        side: Side | None = None
        index, always = 0, False
        for word in words[1:]:
            if word in SIDES or word == "both":
                side = next((s for s in SIDES if s == word), None)
            elif word == "always":
                always = True
            elif word.isdecimal():
                index = int(word)
            else:
                raise ValueError(f"'{word}' is neither left, right, both, always nor the number of an exposure")
        fault = PlantedFault(kinds[0], side, index, sequences=None if always else 1)
        self._bench.plant(fault)
        return f"{fault.kind} at exposure {index} of {side or 'both'}, {'from now on' if always else 'once'}"

    def _wire(self, wires: set[Side], words: list[str]) -> str:
        side = self._side(words)
        wires.add(side)
        return f"the trigger line of the {side} camera"

    def _plug(self, words: list[str], *, there: bool) -> str:
        name = " ".join(words)
        if name == "projector":
            (self._bench.plug_projector if there else self._bench.unplug_projector)()
        else:
            camera = self._bench.cameras[self._side(words)]
            (camera.plug if there else camera.unplug)()
        return f"{name} is {'there' if there else 'gone'}"

    def _mark(self, names: set[str], words: list[str]) -> str:
        name = " ".join(words)
        known = {command.name for command in TABLE}
        if name not in known:
            raise ValueError(f"the projector has no command '{name}'; it has {', '.join(sorted(known))}")
        names.add(name)
        return name

    def _stuck(self, _: list[str]) -> str:
        self._bench.projector.faults.stuck_validation = True
        return "validation never ends"

    def _stale(self, _: list[str]) -> str:
        self._bench.projector.faults.stale_replies = _STALE
        return f"{_STALE} answers to nobody before each of its own"

    def _standby(self, _: list[str]) -> str:
        self._bench.projector.sleep()
        return "the projector sleeps"

    def _scene(self, words: list[str]) -> str:
        try:
            return f"before scene {self._bench.source.place(' '.join(words))}"
        except DriverError as error:
            raise ValueError(str(error)) from error

    def _mend(self, _: list[str]) -> str:
        self._bench.mend()
        return "all is well"

    def _status(self, _: list[str]) -> str:
        bench = self._bench
        found = [f"{fault.kind} at {fault.index} of {fault.side or 'both'}" for fault in bench.faults.planted]
        found += [f"line of {side} inverted" for side in sorted(bench.wiring.inverted)]
        found += [f"line of {side} cut" for side in sorted(bench.wiring.cut)]
        found += [f"{name} refused" for name in sorted(bench.projector.faults.refused)]
        found += [f"{name} not answered" for name in sorted(bench.projector.faults.silent)]
        found += ["validation stuck"] * bench.projector.faults.stuck_validation
        found += ["stale replies"] * bool(bench.projector.faults.stale_replies)
        found += ["projector unplugged"] * (not bench.projector.plugged)
        return f"scene {bench.source.scene}; {', '.join(found) or 'nothing is wrong'}"

    def _side(self, words: list[str]) -> Side:
        for side in SIDES:
            if words == [side]:
                return side
        raise ValueError(f"name left or right, not '{' '.join(words)}'")
