"""Small synthetic foreign sets, and independent decoders that tell whether an import kept their meaning."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from models.capture import Capture
from models.patterns import Pattern

HEIGHT, WIDTH = 4, 96
COLUMN = np.broadcast_to(np.linspace(3.0, 60.0, WIDTH), (HEIGHT, WIDTH))
"""Projector column that each pixel of the synthetic sets sees."""
PERIOD, STEPS, BITS = 12.0, 5, 3


def fringe(k: int, *, steps: int = STEPS, period: float = PERIOD, sign: int = 1, offset: float = 0.0) -> np.ndarray:
    return 110 + 90 * np.cos(2 * np.pi * COLUMN / period - offset - sign * 2 * np.pi * k / steps)


def gray_plane(bit: int, *, bits: int = BITS, period: float = PERIOD) -> np.ndarray:
    """Level 200 where the bit is set, 20 elsewhere; bit 0 is the most significant."""
    order = np.floor(COLUMN / period).astype(int)
    return 20.0 + 180.0 * ((order ^ (order >> 1)) >> (bits - 1 - bit) & 1)


def write(path: Path, image: np.ndarray, *, scale: float = 1.0, dtype: type = np.uint8) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.rint(image * scale).astype(dtype))


def toml(path: Path, text: str) -> Path:
    path.write_text('schema = "foreign-set/1"\n' + text, encoding="utf-8")
    return path


PLAIN = """
[white]
file = "00.png"
[black]
file = "09.png"
[high]
files = "{n:02}.png"
first = 1
steps = 5
period = 12.0
[gray]
files = "{n:02}.png"
first = 6
bits = 3
"""


def write_plain_set(folder: Path) -> None:
    """The files of ``PLAIN``: 00 white, 01.. fringe, 06.. Gray, 09 black, one view."""
    images = [np.full_like(COLUMN, 200.0), *(fringe(k) for k in range(STEPS))]
    images += [*(gray_plane(b) for b in range(BITS)), np.full_like(COLUMN, 20.0)]
    for index, image in enumerate(images):
        write(folder / f"{index:02d}.png", image)


def decoded_phase(capture: Capture, kind: str = "high", side: str = "left") -> np.ndarray:
    """Phase 2 pi u / period by the convention that ``Pattern`` documents."""
    patterns: tuple[Pattern, ...] = capture.plan.of_kind(kind)  # type: ignore[arg-type]
    field = sum(
        image * np.exp(2j * np.pi * p.shift_sign * p.step / p.steps)
        for p, image in zip(patterns, capture.stack(side, kind), strict=True)  # type: ignore[arg-type]
    )
    return np.angle(field * np.exp(1j * patterns[0].phase_offsets[0]))


def decoded_order(capture: Capture, side: str = "left", threshold: float = 110 / 255) -> np.ndarray:
    bits = capture.stack(side, "gray") > threshold  # type: ignore[arg-type]
    return np.bitwise_xor.accumulate(bits, axis=0).astype(int).T.dot(1 << np.arange(len(bits))[::-1]).T


def assert_columns(capture: Capture, *, period: float = PERIOD, order_period: float | None = None) -> None:
    """Both decoders return the column that the set was made with."""
    phase_error = np.angle(np.exp(1j * (decoded_phase(capture) - 2 * np.pi * COLUMN / period)))
    assert np.abs(phase_error).max() < 0.02
    if capture.plan.of_kind("gray"):
        assert np.array_equal(decoded_order(capture), np.floor(COLUMN / (order_period or period)))
