"""Pictures set side by side, with titles, captions and colour bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from service.pictures import ColourScale, Picture

_PAPER, _INK, _SOFT = 255, (45, 40, 38), (120, 112, 106)
_MARGIN, _GAP, _BAR, _TICKS = 28, 22, 12, 42
_HEADER, _TITLE, _CAPTION = 74, 26, 22
_SHORTEST_HEADER = 480


@dataclass(frozen=True)
class Panel:
    """One picture of a figure; ``scale`` draws its colour bar."""

    title: str
    picture: Picture
    caption: str = ""
    scale: ColourScale | None = None


@cache
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


def _write(
    canvas: Picture, text: str, at: tuple[int, int], size: int, colour: tuple[int, int, int], weight: int
) -> None:
    cv2.putText(canvas, text, at, colour, _font(), size, weight)


def compose(title: str, subtitle: str, rows: Sequence[Sequence[Panel]], panel_width: int = 400) -> Picture:
    """A figure: a header and rows of panels of equal width, each with its title above and caption below.

    Panels keep the proportions of their pictures; the tallest of a row sets its height.
    """
    columns = max(len(row) for row in rows)
    lefts = [_MARGIN]
    for index in range(columns):
        has_bar = any(index < len(row) and row[index].scale is not None for row in rows)
        lefts.append(lefts[-1] + panel_width + _GAP + (_BAR + _TICKS if has_bar else 0))
    width = max(lefts[-1] - _GAP + _MARGIN, _MARGIN + _SHORTEST_HEADER)
    heights = [max(_height(panel, panel_width) for panel in row) for row in rows]
    height = _HEADER + sum(h + _TITLE + _CAPTION + _GAP for h in heights) + _MARGIN // 2
    canvas = np.full((height, width, 3), _PAPER, np.uint8)
    _write(canvas, title, (_MARGIN, 36), 24, _INK, 600)
    _write(canvas, subtitle, (_MARGIN, 60), 15, _SOFT, 400)
    top = _HEADER + _TITLE
    for row, row_height in zip(rows, heights, strict=True):
        for index, panel in enumerate(row):
            _draw(canvas, panel, lefts[index], top, panel_width)
        top += row_height + _CAPTION + _GAP + _TITLE
    return canvas


def _height(panel: Panel, width: int) -> int:
    rows: int = panel.picture.shape[0]
    columns: int = panel.picture.shape[1]
    return round(rows * width / columns)


def _draw(canvas: Picture, panel: Panel, left: int, top: int, width: int) -> None:
    height = _height(panel, width)
    shrinks = width < panel.picture.shape[1]
    resized = cv2.resize(panel.picture, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    canvas[top : top + height, left : left + width] = resized
    _write(canvas, panel.title, (left, top - 8), 16, _INK, 600)
    _write(canvas, panel.caption, (left, top + height + 18), 13, _SOFT, 400)
    if panel.scale is not None:
        _draw_bar(canvas, panel.scale, left + width + 8, top, height)


def _draw_bar(canvas: Picture, scale: ColourScale, left: int, top: int, height: int) -> None:
    canvas[top : top + height, left : left + _BAR] = scale.bar(height, _BAR)
    middle = (scale.low + scale.high) / 2
    for value, y in ((scale.high, top + 10), (middle, top + height // 2 + 5), (scale.low, top + height)):
        _write(canvas, _tick(value), (left + _BAR + 5, y), 13, _SOFT, 400)
    _write(canvas, scale.unit, (left + _BAR + 5, top + 27), 12, _SOFT, 400)


def _tick(value: float) -> str:
    text = "π" if np.isclose(abs(value), np.pi) else f"{abs(value):.4g}"
    return f"−{text}" if value < 0 else text
