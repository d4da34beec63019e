"""The video input of an emulated controller: the signal on it, its frames, and when they come onto the mirrors."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.lightcrafter import commands as c
from drivers.lightcrafter import planes
from drivers.lightcrafter.commands import Command
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.values import LutEntry, Mode, PatternSource, Source, Timing, VideoSignal
from models.patterns import LIGHTCRAFTER_4500

Pixels = npt.NDArray[np.uint8]
_SIZE = (LIGHTCRAFTER_4500.columns, LIGHTCRAFTER_4500.rows)
_BLANK = (280, 30)
"""Columns and rows of the board's own mode that are not shown: 1192x1170 in all."""
_PORCH = (240, 20)
_FRAMES_PER_S = 60
_LOCKED = 2
_NONE = VideoSignal(*[0] * 15)


@dataclass(frozen=True, eq=False)
class Frame:
    """serial: counts what was drawn. pixels: (rows, columns, 3) of the planes after the channel swap."""

    serial: int
    pixels: Pixels

    def shown(self, index: int, number: int, depth: int) -> Pixels:
        """Levels on the mirrors (rows, columns), 0..255; ``index`` is that of the frame."""
        return planes.shown(self.pixels, number, depth)


class EmulatedVideo:
    """A graphics card at the parallel port; nothing is plugged in at first.

    A frame that is drawn between two syncs is sent after the next one, and stands on the mirrors after the one after
    that. lock_s: how long the controller takes to lock once it has turned to its input.
    """

    def __init__(self, *, lock_s: float = 0.0) -> None:
        self.lock_s = lock_s
        self._guard = threading.Lock()
        self._size: tuple[int, int] | None = None
        self._steady = False
        self._drawn = self._sent = Frame(0, np.zeros((1, 1, 3), np.uint8))
        self._turned_at: float | None = None

    def connect(self, columns: int = _SIZE[0], rows: int = _SIZE[1], *, steady: bool = True) -> None:
        """Send black frames of this size at 60 Hz; the controller locks to them where they are ``steady``."""
        with self._guard:
            self._size, self._steady = (columns, rows), steady
            self._drawn = self._sent = Frame(self._drawn.serial + 1, np.zeros((rows, columns, 3), np.uint8))

    def disconnect(self) -> None:
        """Lose the signal."""
        with self._guard:
            self._size, self._steady = None, False

    def draw(self, pixels: Pixels) -> None:
        """Send another frame from the next sync on: (rows, columns, 3) green, red, blue as the controller takes them.

        ValueError where it has not the size of the signal.
        """
        with self._guard:
            if self._size is None or pixels.shape != (*self._size[::-1], 3):
                raise ValueError(f"a frame of {pixels.shape} is not of the signal {self._size}")
            self._drawn = Frame(self._drawn.serial + 1, pixels)

    @property
    def plays(self) -> bool:
        """Whether sequences can take their patterns from the signal."""
        with self._guard:
            return self._steady and self._size == _SIZE

    def status(self, values: Mapping[Command[Any], Any]) -> VideoSignal:
        """What a controller with these registers tells of the signal: it locks in video mode only.

        The units of the rates are not known of the real one: here kHz, 10 Hz and 0.01 Hz.
        """
        with self._guard:
            if values[c.DISPLAY_MODE] is not Mode.VIDEO or values[c.INPUT_SOURCE].source is not Source.PARALLEL:
                self._turned_at = None
                return _NONE
            now = time.monotonic()
            self._turned_at = now if self._turned_at is None else self._turned_at
            if self._size is None or not self._steady or now - self._turned_at < self.lock_s:
                return _NONE
            size, total = self._size, (self._size[0] + _BLANK[0], self._size[1] + _BLANK[1])
            lines_per_s = total[1] * _FRAMES_PER_S
            rates = (total[0] * lines_per_s // 1000, lines_per_s // 10, 100 * _FRAMES_PER_S)
            return VideoSignal(_LOCKED, *size, 0, 1, 1, *rates, *total, *size, *_PORCH)

    def next_frame(self, entries: tuple[LutEntry, ...], timing: Timing) -> tuple[Exposure, ...]:
        """A sync: the patterns of the frame that had come in whole; none without a signal."""
        if not self.plays:
            return ()
        with self._guard:
            standing, self._sent = self._sent, self._drawn
        return tuple(
            Exposure(
                index,
                float(index * timing.period_us),
                entry,
                -standing.serial,
                False,
                standing,
                lit_us=float(timing.exposure_us),
                dark_us=0.0,
            )
            for index, entry in enumerate(entries)
        )

    def picture(self, columns: int, rows: int) -> Pixels | None:
        """What video mode shows on so many mirrors: the frame, scaled to them; None without a signal."""
        with self._guard:
            if not self._steady:
                return None
            pixels = self._drawn.pixels
        there = np.ix_(np.arange(rows) * pixels.shape[0] // rows, np.arange(columns) * pixels.shape[1] // columns)
        return pixels[there]


def plays_video(values: Mapping[Command[Any], Any]) -> bool:
    """Whether sequences take their patterns from the video input, by these registers."""
    return values[c.PATTERN_SOURCE] is PatternSource.VIDEO
