"""What the projector's flash holds: which pattern lies in which bits of which image."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.errors import DeviceConfigurationError
from drivers.lightcrafter import planes
from drivers.lightcrafter.commands import NAME
from drivers.lightcrafter.planes import Depth
from models.atomic import atomic_file
from models.patterns import LIGHTCRAFTER_4500, Pattern, PatternPlan, Raster

MAXIMUM_FLASH_IMAGES = 256
FIRMWARE_FORMAT: Final = "duofringe-firmware/1"
"""Of the record beside a firmware file, which has the manifest in it."""
_LARGEST_FILE = 4_000_000
_DEPTHS: tuple[tuple[Depth, int], ...] = ((8, planes.PLANES // 8), (1, planes.PLANES))
"""Bits of a pattern, and how many patterns of so many bits an image takes."""


class StoredPattern(BaseModel):
    """One pattern in flash. image: index of the flash image. number: the controller's for this depth."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    pattern: Pattern
    image: int = Field(ge=0, lt=MAXIMUM_FLASH_IMAGES)
    number: int = Field(ge=0, lt=planes.PLANES)
    depth: Depth

    @model_validator(mode="after")
    def _it_fits(self) -> StoredPattern:
        planes.lowest_plane(self.number, self.depth)
        if self.depth < _depth(self.pattern):
            raise ValueError(f"pattern {self.pattern.name} has more than two grey levels and is stored with 1 bit")
        return self

    @property
    def planes(self) -> frozenset[int]:
        """The bit planes of its image that are its own."""
        first = planes.lowest_plane(self.number, self.depth)
        return frozenset(range(first, first + self.depth))


class FlashManifest(BaseModel):
    """Every pattern in flash, in exposure order."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["duofringe-flash/1"] = "duofringe-flash/1"
    columns: int = Field(LIGHTCRAFTER_4500.columns, ge=1, le=4096)
    rows: int = Field(LIGHTCRAFTER_4500.rows, ge=1, le=4096)
    patterns: tuple[StoredPattern, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _patterns_do_not_overlap(self) -> FlashManifest:
        taken: dict[tuple[int, int], str] = {}
        for stored in self.patterns:
            for plane in stored.planes:
                other = taken.setdefault((stored.image, plane), stored.pattern.name)
                if other != stored.pattern.name:
                    raise ValueError(
                        f"patterns {other} and {stored.pattern.name} share a plane of image {stored.image}"
                    )
        _ = self.plan  # refuses names that stand twice
        return self

    @property
    def plan(self) -> PatternPlan:
        """The patterns in exposure order."""
        return PatternPlan(name="stored", patterns=tuple(s.pattern for s in self.patterns))

    @property
    def raster(self) -> Raster:
        return Raster(self.columns, self.rows, "diamond")

    @property
    def images(self) -> int:
        """How many flash images the patterns need, counted from the first."""
        return 1 + max(s.image for s in self.patterns)

    def render(self, image: int, raster: Raster | None = None) -> npt.NDArray[np.uint8]:
        """Flash image (rows, columns, 3): green, red, blue, the order of the planes. raster: of the mirrors."""
        raster = raster or self.raster
        pixels = np.zeros((raster.rows, raster.columns, 3), np.uint8)
        for stored in self.patterns:
            if stored.image == image:
                planes.insert(pixels, stored.number, stored.depth, stored.pattern.render(raster))
        return pixels

    @classmethod
    def packed(cls, plan: PatternPlan, first_image: int = 0) -> FlashManifest:
        """Three 8-bit patterns an image, in green, red and blue; then the two-level patterns, one plane each.

        Patterns along rows and along columns never share an image: apart, either compresses well and loads fast.
        """
        places: dict[str, tuple[int, int, Depth]] = {}
        image = first_image
        for depth, at_once in _DEPTHS:
            for row_coded in (False, True):
                group = [p for p in plan.patterns if _depth(p) == depth and p.is_row_coded == row_coded]
                for k, pattern in enumerate(group):
                    places[pattern.name] = (image + k // at_once, k % at_once, depth)
                image += -(-len(group) // at_once)
        return cls(patterns=tuple(_placed(pattern, places) for pattern in plan.patterns))

    @classmethod
    def from_file(cls, path: Path) -> FlashManifest:
        """A manifest, or the one in the record that ``firmware build`` writes.

        Raises DeviceConfigurationError for a file that is missing, damaged or no manifest.
        """
        try:
            if path.stat().st_size > _LARGEST_FILE:
                raise ValueError("it is too large")
            content = json.loads(path.read_bytes())
            if isinstance(content, dict) and content.get("format") == FIRMWARE_FORMAT:
                content = content.get("manifest")
            return cls.model_validate(content)
        except (OSError, ValidationError, ValueError, RecursionError) as error:
            advice = f"{_reason(error)}; name the one that 'duofringe patterns export' or 'firmware build' wrote"
            raise DeviceConfigurationError(NAME, "manifest", path, f"the file cannot be used: {advice}") from error

    def write(self, path: Path) -> None:
        """Complete under its name, or not there."""
        with atomic_file(path) as partial:
            partial.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")


def _reason(error: Exception) -> str:
    """The first thing that is wrong, in one line."""
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "it"
        return f"{place}: {first['msg'].removeprefix('Value error, ')}"
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())[:200]


def _depth(pattern: Pattern) -> Depth:
    return 1 if pattern.is_gray or pattern.is_uniform else 8


def _placed(pattern: Pattern, places: Mapping[str, tuple[int, int, Depth]]) -> StoredPattern:
    image, number, depth = places[pattern.name]
    return StoredPattern(pattern=pattern, image=image, number=number, depth=depth)
