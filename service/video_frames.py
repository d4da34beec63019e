"""Patterns as frames for the projector's video input: 912x1140 at 60 Hz, several patterns a frame.

The controller divides a frame by bits as it does a flash image, and one frame's time among its patterns. All frames of
one depth can be shown with one pattern LUT; between the depths the controller must be stopped and told anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from drivers.lightcrafter import planes
from drivers.lightcrafter.bitmaps import write_image
from drivers.lightcrafter.planes import Depth
from drivers.lightcrafter.sequence import VIDEO_FRAME_US
from drivers.lightcrafter.splash import Pixels
from drivers.lightcrafter.video import CHANNEL_SWAP
from models.atomic import atomic_folder, write_text_atomically
from models.patterns import LIGHTCRAFTER_4500, Pattern, PatternPlan, Raster

_DEPTHS: tuple[Depth, ...] = (8, 1)


class ShownPattern(BaseModel):
    """One pattern of a frame. number: the controller's for the frame's depth. pattern: None for dark."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    number: int = Field(ge=0, lt=planes.PLANES)
    pattern: Pattern | None


class VideoFrame(BaseModel):
    """One frame and its patterns in the order in which they are shown; period_us equals exposure_us."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    file: str
    depth: Depth
    exposure_us: int
    period_us: int
    patterns: tuple[ShownPattern, ...]


class VideoManifest(BaseModel):
    """Frames in the order of their display. frame_us: time of one frame. channel_swap: of the controller's input."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["duofringe-video/1"] = "duofringe-video/1"
    columns: int = LIGHTCRAFTER_4500.columns
    rows: int = LIGHTCRAFTER_4500.rows
    frame_us: int = VIDEO_FRAME_US
    channel_swap: int = CHANNEL_SWAP
    frames: tuple[VideoFrame, ...]

    def render(self, frame: VideoFrame) -> Pixels:
        """(rows, columns, 3): green, red, blue."""
        raster = Raster(self.columns, self.rows, "diamond")
        pixels = np.zeros((self.rows, self.columns, 3), np.uint8)
        for shown in frame.patterns:
            if shown.pattern is not None:
                planes.insert(pixels, shown.number, frame.depth, shown.pattern.render(raster))
        return pixels


def pack_frames(plan: PatternPlan) -> VideoManifest:
    """As many patterns a frame as its time allows: two of 8 bits, 24 of one. The 8-bit ones come first."""
    frames: list[VideoFrame] = []
    for depth in _DEPTHS:
        members = [p for p in plan.patterns if (p.is_gray or p.is_uniform) == (depth == 1)]
        at_once = min(planes.PLANES // depth, VIDEO_FRAME_US // planes.minimum_exposure_us(depth), len(members))
        for start in range(0, len(members), max(1, at_once)):
            exposure_us = VIDEO_FRAME_US // at_once
            shown: list[Pattern | None] = list(members[start : start + at_once])
            shown += [None] * (at_once - len(shown))
            frames.append(
                VideoFrame(
                    file=f"frame_{len(frames):02d}.png",
                    depth=depth,
                    exposure_us=exposure_us,
                    period_us=exposure_us,
                    patterns=tuple(ShownPattern(number=k, pattern=p) for k, p in enumerate(shown)),
                )
            )
    return VideoManifest(frames=tuple(frames))


def export_frames(folder: Path, plan: PatternPlan) -> VideoManifest:
    """Write ``frame_00.png`` ... (24-bit RGB, 912x1140) and ``manifest.json``.

    The folder must not exist yet; it appears complete or not at all. Raises DuofringeError otherwise.
    """
    manifest = pack_frames(plan)
    with atomic_folder(folder) as partial:
        for frame in manifest.frames:
            write_image(partial / frame.file, manifest.render(frame))
        write_text_atomically(partial / "manifest.json", manifest.model_dump_json(indent=1) + "\n")
    return manifest
