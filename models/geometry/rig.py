"""The calibrated rig: two cameras and, where known, the projector, in one frame and one file."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from models.atomic import write_text_atomically
from models.errors import CalibrationError
from models.geometry.device import Device
from models.geometry.opencv_files import read_opencv_cameras
from models.patterns import Raster, RasterKind

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
SCHEMA = "rig-calibration/1"
_COMMON_FIELD = 0.9
_SEARCH_DEPTHS_MM = np.geomspace(20.0, 20_000.0, 300)


@dataclass(frozen=True, eq=False)
class Rig:
    """Left camera (the world frame: x right, y down, z forward, mm), right camera and optional projector.

    raster: the projector's mirrors, None without a projector. quality: free-form facts about the calibration.
    """

    left: Device
    right: Device
    projector: Device | None = None
    raster: Raster | None = None
    quality: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if float(np.linalg.norm(self.right.centre - self.left.centre)) < 1e-6:
            raise CalibrationError("right: translation is zero; the cameras need a baseline (units are mm)")
        if (self.projector is None) != (self.raster is None):
            raise CalibrationError("projector: a projector and its raster come together")
        if self.projector and self.raster and self.projector.size != (self.raster.columns, self.raster.rows):
            raise CalibrationError(
                f"projector: size is {list(self.projector.size)} but its raster has "
                f"{self.raster.columns} columns and {self.raster.rows} rows"
            )

    @cached_property
    def fingerprint(self) -> str:
        """Text that two rigs share exactly when their calibrations are the same; caches of what is built go by it."""
        return json.dumps(self.to_dict(), sort_keys=True, default=str)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rig) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)

    @property
    def cameras(self) -> dict[Side, Device]:
        return {"left": self.left, "right": self.right}

    @cached_property
    def from_the_right(self) -> Rig:
        """The same rig in the right camera's frame, where it stands as the left one and the left one as the right."""
        right = self.right
        turned = {device: _in_frame_of(right, device) for device in (self.left, self.projector) if device is not None}
        projector = None if self.projector is None else turned[self.projector]
        first = replace(right, rotation=np.eye(3), translation=np.zeros(3), name="left")
        return Rig(first, replace(turned[self.left], name="right"), projector, self.raster, dict(self.quality))

    @cached_property
    def working_depths(self) -> tuple[float, float]:
        """The common working volume: depths (mm) at which every device sees 90 % of the left camera's field.

        ``quality["working_range_mm"]``, where a calibration states it, goes before the estimate. Where no depth
        reaches 90 %, the depths that reach nine tenths of the best. Raises CalibrationError when the devices share no
        field at all.
        """
        stated = self.quality.get("working_range_mm")
        if isinstance(stated, list | tuple) and len(stated) == 2 and all(isinstance(z, int | float) for z in stated):
            near, far = (float(z) for z in stated)
            if 0 < near < far < math.inf:
                return near, far
        grid = self.left.pixel_grid()[::16, ::16].reshape(-1, 2)
        rays = self.left.rays(grid)
        others = [self.right] + ([self.projector] if self.projector else [])
        share = np.array(
            [np.all([d.contains(d.project(rays * z)) for d in others], axis=0).mean() for z in _SEARCH_DEPTHS_MM]
        )
        best = float(share.max())
        if best < 0.05:
            raise CalibrationError(
                "the devices see no common volume; are the views swapped, or the translation not in mm?"
            )
        good = np.flatnonzero(share >= min(_COMMON_FIELD, _COMMON_FIELD * best))
        peak = int(share.argmax())
        breaks = np.flatnonzero(np.diff(good) > 1)
        runs = np.split(good, breaks + 1)
        run = next(r for r in runs if r[0] <= peak <= r[-1])
        return float(_SEARCH_DEPTHS_MM[run[0]]), float(_SEARCH_DEPTHS_MM[run[-1]])

    def to_dict(self) -> dict[str, Any]:
        """The ``rig-calibration/1`` object, JSON-ready."""
        result: dict[str, Any] = {"schema": SCHEMA, "units": "mm", "left": _device_to_dict(self.left, posed=False)}
        result["right"] = _device_to_dict(self.right, posed=True)
        if self.projector is not None and self.raster is not None:
            result["projector"] = {**_device_to_dict(self.projector, posed=True), "raster": self.raster.kind}
        result["quality"] = self.quality
        return result

    @classmethod
    def from_dict(cls, data: Any) -> Rig:
        """Parse a ``rig-calibration/1`` object; raises CalibrationError naming the field at fault."""
        if not isinstance(data, dict):
            raise CalibrationError("calibration is not a JSON object")
        if data.get("schema") != SCHEMA:
            raise CalibrationError(f"calibration schema is {data.get('schema')!r}, expected '{SCHEMA}'")
        if data.get("units", "mm") != "mm":
            raise CalibrationError(f"calibration units are {data['units']!r}; only 'mm' is read")
        projector = raster = None
        if data.get("projector") is not None:
            projector = _device_from_dict(data, "projector", posed=True)
            kind = data["projector"].get("raster", "square")
            if kind not in ("square", "diamond"):
                raise CalibrationError(f"projector: raster is {kind!r}, expected 'square' or 'diamond'")
            raster_kind: RasterKind = kind
            raster = Raster(projector.width, projector.height, raster_kind)
        quality = data.get("quality") or {}
        if not isinstance(quality, dict):
            raise CalibrationError("quality is not a JSON object")
        left = _device_from_dict(data, "left", posed=False)
        return cls(left, _device_from_dict(data, "right", posed=True), projector, raster, quality)

    @classmethod
    def from_file(cls, path: Path | str, *, size: tuple[int, int] | None = None) -> Rig:
        """Read ``calibration.json`` or an OpenCV YAML/XML stereo file; raises CalibrationError with the file's name.

        size: (width, height) of the cameras for OpenCV files, which seldom tell it.
        """
        path = Path(path)
        if not path.is_file():
            raise CalibrationError(f"calibration file '{path}' does not exist")
        try:
            if path.suffix.lower() in (".yml", ".yaml", ".xml"):
                return cls(*read_opencv_cameras([path], size=size), quality={"source": path.name})
            return cls.from_dict(json.loads(path.read_text(encoding="utf-8")))
        except CalibrationError as error:
            text = str(error)
            raise CalibrationError(text if text.startswith(str(path)) else f"{path}: {text}") from error
        except (ValueError, OSError, RecursionError) as error:
            raise CalibrationError(f"{path}: not readable as a calibration ({error})") from error

    def to_file(self, path: Path | str) -> None:
        """Write ``calibration.json`` atomically; the folder must exist."""
        write_text_atomically(Path(path), json.dumps(self.to_dict(), indent=2) + "\n")


def _in_frame_of(frame: Device, device: Device) -> Device:
    """``device`` as seen by a world whose origin and axes are those of ``frame``."""
    rotation = device.rotation @ frame.rotation.T
    return replace(device, rotation=rotation, translation=device.translation - rotation @ frame.translation)


def _device_to_dict(device: Device, *, posed: bool) -> dict[str, Any]:
    result: dict[str, Any] = {
        "size": list(device.size),
        "matrix": device.matrix.tolist(),
        "distortion": device.distortion.tolist(),
    }
    if posed:
        result |= {"rotation": device.rotation.tolist(), "translation": device.translation.tolist()}
    return result


def _device_from_dict(data: dict[str, Any], name: str, *, posed: bool) -> Device:
    entry = data.get(name)
    if not isinstance(entry, dict):
        raise CalibrationError(f"calibration lacks '{name}'")
    keys = ("size", "matrix", "distortion", *(("rotation", "translation") if posed else ()))
    missing = [key for key in keys if key not in entry]
    if missing:
        raise CalibrationError(f"{name}: lacks {', '.join(missing)}")
    size = entry["size"]
    if not (
        isinstance(size, list | tuple)
        and len(size) == 2
        and all(isinstance(n, int) or (isinstance(n, float) and n.is_integer()) for n in size)
    ):
        raise CalibrationError(f"{name}: size must be [width, height] in whole pixels, got {size!r}")
    pose = {key: entry[key] for key in keys[3:]}
    return Device((int(size[0]), int(size[1])), entry["matrix"], entry["distortion"], name=name, **pose)
