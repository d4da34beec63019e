"""Where the images of a virtual rig come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.camera import AppliedSettings, BitDepth, CameraInfo
from drivers.projector import ProjectorInfo
from drivers.stage import Stage
from models.capture import Image
from models.geometry.rig import Side
from models.patterns import Pattern, PatternPlan


@dataclass(frozen=True)
class PixelFormat:
    """What a camera delivers. size: (width, height) px. white_level: reading of a saturated pixel."""

    size: tuple[int, int]
    bit_depth: int
    white_level: int


class SceneSource(Stage, Protocol):
    """A stage that also knows how its present scene looks to both cameras. Calls may come from several threads."""

    def camera_info(self, side: Side) -> CameraInfo: ...

    @property
    def projector_info(self) -> ProjectorInfo: ...

    def pixel_format(self, side: Side, bit_depth: BitDepth) -> PixelFormat:
        """What a camera delivers that was asked for ``bit_depth``."""
        ...

    def prepare(self, plan: PatternPlan) -> None:
        """Do now what would make the first ``image`` of each pattern slow."""
        ...

    def image(
        self, side: Side, pattern: Pattern, settings: AppliedSettings, *, lit_us: float, brightness: float, shot: int
    ) -> Image:
        """One exposure (height, width) of a sequence.

        lit_us: how long the projector shows the pattern while the shutter is open. brightness: of the projector, 0..1.
        shot: counts the exposures of this camera, so that two of them differ as real ones do. Raises CaptureError for
        a pattern that cannot be shown.
        """
        ...

    def view(
        self, side: Side, pattern: Pattern | None, settings: AppliedSettings, *, brightness: float, shot: int
    ) -> Image:
        """One exposure (height, width) of the live view: a held pattern, or the dark, or the nearest there is."""
        ...
