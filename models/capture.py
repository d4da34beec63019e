"""Capture folders: what is written is what is replayed (see docs/formats.md)."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from models.atomic import atomic_folder
from models.errors import CaptureError, DuofringeError
from models.geometry.rig import SIDES, Rig, Side
from models.npy import read_npy, write_npy
from models.patterns import Pattern, PatternIndexError, PatternKind, PatternPlan, make_pattern
from models.png import Image as Image
from models.png import png_header, read_png, read_pngs, write_png, write_pngs

RECORD_NAME = "capture.json"
SCHEMA: Literal["capture/1"] = "capture/1"


class DeviceRecord(BaseModel):
    """Which device took part, and whether it was hardware."""

    role: Literal["left", "right", "projector"]
    driver: str
    model: str = ""
    serial: str = ""
    firmware: str = ""
    origin: Literal["real", "simulated", "replayed", "imported"] = "real"


class CaptureRecord(BaseModel):
    """``capture.json``: everything about a capture except its pixels. Unknown keys are kept."""

    model_config = ConfigDict(extra="allow", populate_by_name=True)

    schema_: Literal["capture/1"] = Field(default=SCHEMA, alias="schema")
    id: str = ""
    created: datetime = Field(default_factory=lambda: datetime.now(UTC))
    plan: str = "custom"
    patterns: tuple[Pattern, ...] = ()
    devices: tuple[DeviceRecord, ...] = ()
    settings: dict[str, Any] = Field(default_factory=dict)
    frame_ids: dict[Side, list[int]] = Field(default_factory=dict)
    timestamps_ns: dict[Side, list[int]] = Field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    object_id: str | None = None
    bit_depth: int = Field(8, ge=1, le=16)
    white_level: int | None = Field(None, ge=1, le=65535)
    calibration: dict[str, Any] | None = None

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulator knows, on the left sensor's grid (height, width).

    depth: float32 mm, NaN where the left camera sees nothing in range. projector_column: float32 mirrors (u).
    foreground: bool, seen by both cameras, lit by the projector and in range. ``extra`` arrays are kept by name.
    """

    depth: npt.NDArray[np.float32]
    projector_column: npt.NDArray[np.float32]
    foreground: npt.NDArray[np.bool_]
    extra: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Capture:
    """One or two views of one scene under a plan of patterns.

    images: per side, per pattern name, uint8 or uint16 of shape (height, width). white_level: the sensor's full scale.
    """

    plan: PatternPlan
    images: Mapping[Side, Mapping[str, Image]]
    rig: Rig | None = None
    record: CaptureRecord = field(default_factory=lambda: CaptureRecord())
    truth: Truth | None = None
    source: str = "capture"

    @property
    def sides(self) -> tuple[Side, ...]:
        return tuple(side for side in SIDES if side in self.images)

    @property
    def white_level(self) -> int:
        return self.record.white_level or 2**self.record.bit_depth - 1

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) of the left images; raises CaptureError when none were loaded."""
        first = next(iter(self.images["left"].values()), None)
        if first is None:
            raise CaptureError(f"{self.source}: no images were loaded")
        return first.shape[1], first.shape[0]

    def stack(self, side: Side, kind: PatternKind) -> npt.NDArray[np.float32]:
        """Images of one kind in plan order, float32 (n, height, width), scaled so that the white level is 1.

        Raises CaptureError when the capture has none of them.
        """
        patterns = self.plan.of_kind(kind)
        if not patterns:
            raise CaptureError(f"{self.source}: has no '{kind}' images")
        return np.stack([self.images[side][p.name] for p in patterns]).astype(np.float32) / np.float32(self.white_level)

    def require(self, kinds: Collection[PatternKind], purpose: str) -> None:
        """Raise CaptureError naming the pattern groups that ``purpose`` needs and the capture lacks."""
        missing = sorted(set(kinds) - self.plan.kinds)
        if missing:
            groups = ", ".join(missing)
            raise CaptureError(f"{self.source}: {purpose} needs the pattern groups {groups}, which the capture lacks")

    def require_two_views(self, purpose: str) -> None:
        """Raise CaptureError when there is only a left view."""
        if "right" not in self.images:
            raise CaptureError(f"{self.source}: {purpose} needs two views; the folder has no right/")


class CaptureOutline(NamedTuple):
    """A capture folder without its pixels. record: None where there is no ``capture.json``. size: (width, height)."""

    record: CaptureRecord | None
    plan: PatternPlan
    sides: tuple[Side, ...]
    size: tuple[int, int]


def read_outline(folder: Path | str) -> CaptureOutline:
    """What a capture folder holds, from its record, its file names and the header of one image.

    Raises CaptureError as ``read_capture`` does, for everything that is found without reading pixels.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise CaptureError(f"capture '{folder}' is not a folder")
    record, plan, sides = _read_structure(folder)
    header = png_header(folder / "left" / f"{plan.patterns[0].name}.png")
    return CaptureOutline(record, plan, sides, (header.width, header.height))


def read_capture(
    folder: Path | str, *, kinds: Collection[PatternKind] | None = None, with_truth: bool = True
) -> Capture:
    """Read and validate a capture folder.

    kinds: load only these pattern groups (the folder is still checked as a whole); None loads all.
    Raises CaptureError naming the folder, the file at fault, and what to do.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise CaptureError(f"capture '{folder}' is not a folder")
    record, plan, sides = _read_structure(folder)
    wanted = plan.patterns if kinds is None else tuple(p for p in plan.patterns if p.kind in kinds)
    decoded = iter(read_pngs([folder / s / f"{p.name}.png" for s in sides for p in wanted]))
    images: dict[Side, dict[str, Image]] = {s: {p.name: next(decoded) for p in wanted} for s in sides}
    _check_sizes(folder, images)
    record = _with_depth_of(record, images, folder)
    try:
        rig = None if record.calibration is None else Rig.from_dict(record.calibration)
    except DuofringeError as error:
        raise CaptureError(f"{folder / RECORD_NAME}: {error}") from error
    truth = _read_truth(folder, images) if with_truth else None
    loaded = plan.restricted_to(p.name for p in wanted)
    return Capture(loaded, images, rig, record, truth, source=str(folder))


def write_capture(capture: Capture, folder: Path | str) -> None:
    """Write a capture folder atomically under a name that must not exist yet; its parent must."""
    record = capture.record.model_copy(
        update={
            "plan": capture.plan.name,
            "patterns": capture.plan.patterns,
            "calibration": None if capture.rig is None else capture.rig.to_dict(),
        }
    )
    with atomic_folder(Path(folder)) as partial:
        for side in capture.images:
            (partial / side).mkdir()
        write_pngs(
            {
                partial / side / f"{pattern.name}.png": images[pattern.name]
                for side, images in capture.images.items()
                for pattern in capture.plan.patterns
            }
        )
        if capture.truth is not None:
            _write_truth(capture.truth, partial / "truth")
        (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")


def _read_structure(folder: Path) -> tuple[CaptureRecord | None, PatternPlan, tuple[Side, ...]]:
    """Record, plan and sides of a folder whose files are all there."""
    record = _read_record(folder)
    plan = _plan_of(folder, record)
    sides = SIDES if (folder / "right").is_dir() or _tells_of_right(record) else SIDES[:1]
    _check_complete(folder, plan, sides)
    return record, plan, sides


def _read_record(folder: Path) -> CaptureRecord | None:
    path = folder / RECORD_NAME
    if not path.exists():
        return None
    try:
        return CaptureRecord.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise CaptureError(f"{path}: {_first_fault(error)}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise CaptureError(f"{path}: not readable as JSON ({error})") from error


def _first_fault(error: ValidationError) -> str:
    """Where and what of the first thing that pydantic found, in one line."""
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"]) or "content"
    return f"{where}: {first['msg']}"


def _tells_of_right(record: CaptureRecord | None) -> bool:
    """Whether a second view was recorded, so that a lost right/ is damage and not a one-camera capture."""
    return record is not None and ("right" in record.frame_ids or any(d.role == "right" for d in record.devices))


def _plan_of(folder: Path, record: CaptureRecord | None) -> PatternPlan:
    """The recorded plan, or default parameters for whatever known names stand in the folder."""
    if record is not None and record.patterns:
        try:
            return PatternPlan(name=record.plan, patterns=record.patterns)
        except ValidationError as error:
            raise CaptureError(f"{folder / RECORD_NAME}: patterns: {_first_fault(error)}") from error
    names = {path.stem for side in SIDES for path in (folder / side).glob("*.png")}
    patterns = []
    for name in sorted(names):
        try:
            patterns.append(make_pattern(name))
        except PatternIndexError as error:
            raise CaptureError(f"{folder}: {error}") from error
        except DuofringeError:
            continue
    if not patterns:
        raise CaptureError(f"{folder}: has neither {RECORD_NAME} nor any pattern image in left/")
    return PatternPlan(patterns=tuple(sorted(patterns, key=_exposure_order)))


_KIND_ORDER: tuple[PatternKind, ...] = (
    "white",
    "composite",
    "high",
    "low",
    "gray",
    "gray_inv",
    "row_high",
    "row_low",
    "row_gray",
    "row_gray_inv",
    "black",
)


def _exposure_order(pattern: Pattern) -> tuple[int, int]:
    return _KIND_ORDER.index(pattern.kind), pattern.step or pattern.bit or 0


def _check_complete(folder: Path, plan: PatternPlan, sides: tuple[Side, ...]) -> None:
    """Every group whole, and equal in both views."""
    missing = [
        f"{side}/{p.name}.png"
        for side in sides
        for p in plan.patterns
        if not (folder / side / f"{p.name}.png").is_file()
    ]
    missing += [f"{side}/{name}.png" for side in sides for name in plan.missing_members]
    if missing:
        shown = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
        raise CaptureError(f"{folder}: damaged capture: lacks {shown}; restore the files or capture again")


def _check_sizes(folder: Path, images: Mapping[Side, Mapping[str, Image]]) -> None:
    for side, by_name in images.items():
        shapes = {name: image.shape for name, image in by_name.items()}
        if not shapes:
            continue
        first_name, first = next(iter(shapes.items()))
        for name, shape in shapes.items():
            if shape != first:
                sizes = f"{name}.png is {shape[1]}x{shape[0]} but {first_name}.png is {first[1]}x{first[0]}"
                raise CaptureError(f"{folder / side}: {sizes}; all images of a view have one size")


def _with_depth_of(
    record: CaptureRecord | None, images: Mapping[Side, Mapping[str, Image]], folder: Path
) -> CaptureRecord:
    """The record with the images' own depth where it states none; raises CaptureError where both disagree."""
    depths = {16 if image.dtype == np.uint16 else 8 for by_name in images.values() for image in by_name.values()}
    if len(depths) > 1:
        raise CaptureError(f"{folder}: mixes 8-bit and 16-bit images; a capture has one bit depth")
    depth = max(depths, default=8)
    if record is None:
        return CaptureRecord(id=folder.name, bit_depth=depth)
    if "bit_depth" not in record.model_fields_set:
        return record.model_copy(update={"bit_depth": depth})
    if depths and record.bit_depth > depth:
        raise CaptureError(f"{folder / RECORD_NAME}: bit_depth is {record.bit_depth} but the images have {depth} bits")
    for side, by_name in images.items():
        for name, image in by_name.items():
            if image.max() >= 2**record.bit_depth:
                raise CaptureError(
                    f"{folder / side / name}.png: reaches {image.max()} but bit_depth is {record.bit_depth} "
                    f"in {RECORD_NAME}; state the depth of the pixel values there"
                )
    return record


def _read_truth(folder: Path, images: Mapping[Side, Mapping[str, Image]]) -> Truth | None:
    directory = folder / "truth"
    if not directory.is_dir():
        return None
    depth = read_npy(directory / "depth.npy").astype(np.float32)
    column = read_npy(directory / "projector_column.npy").astype(np.float32)
    foreground = read_png(directory / "foreground.png") > 0
    names = sorted(p.stem for p in directory.glob("*.npy") if p.stem not in ("depth", "projector_column"))
    extra = {name: read_npy(directory / f"{name}.npy") for name in names}
    shapes = {depth.shape, column.shape, foreground.shape, *(image.shape for image in images["left"].values())}
    if len(shapes) > 1:
        raise CaptureError(f"{directory}: depth, projector_column, foreground and the left images differ in size")
    return Truth(depth, column, foreground, extra)


def _write_truth(truth: Truth, directory: Path) -> None:
    directory.mkdir()
    write_npy(directory / "depth.npy", truth.depth.astype(np.float32))
    write_npy(directory / "projector_column.npy", truth.projector_column.astype(np.float32))
    write_png(directory / "foreground.png", truth.foreground.astype(np.uint8) * np.uint8(255))
    for name, array in truth.extra.items():
        write_npy(directory / f"{name}.npy", array)
