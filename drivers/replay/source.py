"""Recorded captures before virtual devices."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.camera import AppliedSettings, BitDepth, CameraInfo, CameraLimits
from drivers.errors import DeviceNotFoundError
from drivers.projector import ProjectorInfo, ProjectorLimits
from drivers.replay.shelf import NAME, scan
from drivers.virtual.source import PixelFormat
from models.capture import Capture, DeviceRecord, Image, Truth, read_capture
from models.errors import CaptureError
from models.geometry.rig import Rig, Side
from models.patterns import MINIMUM_8BIT_EXPOSURE_US, Pattern, PatternPlan

_LIMITS = CameraLimits(exposure_us=(20.0, 350_000.0), gain_db=(0.0, 24.0), bit_depths=(8, 12))
"""Settings change nothing of a recording; those of the simulated cameras are taken and reported."""


class ReplaySource:
    """Implements SceneSource on recorded captures, in name order and round again.

    folder: a capture folder, a folder of them, or a dataset. Images are the recorded ones bit for bit, whatever the
    settings. Only the present capture is in memory. warnings: what was left out of the folder, and why. Raises
    DeviceNotFoundError where the folder has no usable capture.
    """

    def __init__(self, folder: Path | str) -> None:
        self._shelf = scan(Path(folder))
        self._names = list(self._shelf.captures)
        self._lock = threading.RLock()
        self._warnings = list(self._shelf.warnings)
        self._next = 0
        self._scene, self._capture = self._first_readable()

    def _first_readable(self) -> tuple[str, Capture]:
        """So that something stands there before anything is placed."""
        faults: list[str] = []
        for name in list(self._names):
            try:
                capture = self._read(name)
            except CaptureError as error:
                faults.append(f"capture '{name}' is left out of the replay: {error}")
                self._names.remove(name)
                continue
            self._warnings += faults
            return name, capture
        raise DeviceNotFoundError(NAME, f"'{self._shelf.folder}' has no usable capture; {faults[0]}")

    def _read(self, name: str) -> Capture:
        return read_capture(self._shelf.captures[name])

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(self._warnings)

    @property
    def scenes(self) -> Sequence[str]:
        return tuple(self._names)

    @property
    def scene(self) -> str:
        return self._scene

    def place(self, name: str | None = None) -> str:
        """See ``Stage``. After a damaged capture the round goes on; a name is looked up, never used as a path."""
        with self._lock:
            if name is None:
                name = self._names[self._next]
            elif name not in self._names:
                raise DeviceNotFoundError(NAME, f"'{self._shelf.folder}' has no usable capture {name[:80]!r}")
            self._next = (self._names.index(name) + 1) % len(self._names)
            if name != self._scene:
                self._capture = self._read(name)
                self._scene = name
            return name

    @property
    def calibration(self) -> Rig | None:
        return self._capture.rig if self._capture.rig is not None else self._shelf.rig

    @property
    def truth(self) -> Truth | None:
        return self._capture.truth

    @property
    def provenance(self) -> dict[str, Any]:
        """Name and record of the capture that is replayed, "created" None where the record does not tell."""
        with self._lock:
            record = self._capture.record
            told = record.model_dump(mode="json", include={"id", "created", "settings", "devices", "warnings"})
            if "created" not in record.model_fields_set:
                told["created"] = None
            return {"replayed": self._scene, **told}

    @property
    def object_id(self) -> str | None:
        return self._capture.record.object_id

    def _device(self, role: str) -> DeviceRecord | None:
        return next((d for d in self._capture.record.devices if d.role == role), None)

    def camera_info(self, side: Side) -> CameraInfo:
        recorded = self._device(side)
        return CameraInfo(
            driver="replay",
            model=recorded.model if recorded else "",
            serial=recorded.serial if recorded else "",
            firmware=recorded.firmware if recorded else "",
            origin="replayed",
            size=self.pixel_format(side, 8).size,
            limits=_LIMITS,
        )

    @property
    def projector_info(self) -> ProjectorInfo:
        with self._lock:
            recorded, rig = self._device("projector"), self.calibration
            stored = _loadable(self._capture.plan)
        return ProjectorInfo(
            driver="replay",
            model=recorded.model if recorded else "",
            serial=recorded.serial if recorded else "",
            firmware=recorded.firmware if recorded else "",
            origin="replayed",
            raster=rig.raster if rig else None,
            limits=_limits_for(stored),
            stored=stored,
        )

    def pixel_format(self, side: Side, bit_depth: BitDepth) -> PixelFormat:
        """As recorded, whatever is asked."""
        capture = self._capture
        height, width = next(iter(capture.images[side].values())).shape
        return PixelFormat((width, height), capture.record.bit_depth, capture.white_level)

    def prepare(self, plan: PatternPlan) -> None:
        """Everything is in memory since the capture was placed."""

    def image(
        self, side: Side, pattern: Pattern, settings: AppliedSettings, *, lit_us: float, brightness: float, shot: int
    ) -> Image:
        with self._lock:
            recorded = self._recorded(side, pattern)
            if recorded is None:
                raise CaptureError(
                    f"{self._capture.source}: pattern '{pattern.name}' is not recorded; load its own plan"
                )
            return recorded

    def view(
        self, side: Side, pattern: Pattern | None, settings: AppliedSettings, *, brightness: float, shot: int
    ) -> Image:
        """What was recorded of the pattern; else the black image for the dark, else white, composite, or any."""
        with self._lock:
            recorded = None if pattern is None else self._recorded(side, pattern)
            if recorded is not None:
                return recorded
            plan, images = self._capture.plan, self._capture.images[side]
            wanted = ("black", "white", "composite") if pattern is None else ("white", "composite")
            instead = (p for kind in wanted for p in plan.patterns if p.kind == kind)
            return images[next(instead, plan.patterns[0]).name]

    def _recorded(self, side: Side, pattern: Pattern) -> Image | None:
        """The image of this very pattern; its exposure time does not matter."""
        same = (p for p in self._capture.plan.patterns if p.name == pattern.name)
        found = next(same, None)
        if found is None or found.model_copy(update={"exposure_us": pattern.exposure_us}) != pattern:
            return None
        return self._capture.images[side][pattern.name]


def _loadable(plan: PatternPlan) -> PatternPlan:
    """The recorded plan with an exposure where none was recorded."""
    default = {"exposure_us": float(MINIMUM_8BIT_EXPOSURE_US)}
    patterns = tuple(p if p.exposure_us is not None else p.model_copy(update=default) for p in plan.patterns)
    return PatternPlan(name=plan.name, patterns=patterns)


def _limits_for(plan: PatternPlan) -> ProjectorLimits:
    """The usual limits, widened so that what was recorded can be loaded."""
    usual = ProjectorLimits()
    exposures = [p.exposure_us for p in plan.patterns if p.exposure_us is not None]
    binary = [p.exposure_us or 0.0 for p in plan.patterns if p.is_uniform or p.is_gray]
    low, high = usual.exposure_us
    return replace(
        usual,
        exposure_us=(min([low, *exposures]), max([high, *exposures])),
        binary_exposure_us=min([usual.binary_exposure_us, *binary]),
        patterns=max(usual.patterns, len(plan)),
    )
