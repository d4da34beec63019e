"""Capture folders: what is written is what is replayed (see docs/formats.md)."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from models.atomic import atomic_folder
from models.errors import CaptureError, DuofringeError
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import Pattern, PatternKind, PatternPlan, make_pattern

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
RECORD_NAME = "capture.json"
SCHEMA: Literal["capture/1"] = "capture/1"
PNG_COMPRESSION = 1


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
    white_level: int | None = None
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
        """(width, height) of the images."""
        height, width = next(iter(self.images["left"].values())).shape
        return width, height

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
    record = _read_record(folder)
    plan = _plan_of(folder, record)
    sides = SIDES if (folder / "right").is_dir() else SIDES[:1]
    _check_complete(folder, plan, sides)
    wanted = plan.patterns if kinds is None else tuple(p for p in plan.patterns if p.kind in kinds)
    images: dict[Side, dict[str, Image]] = {
        s: {p.name: _read_image(folder / s / f"{p.name}.png") for p in wanted} for s in sides
    }
    images = dict(images.items())
    record = _with_depth_of(record, images, folder)
    _check_sizes(folder, images)
    try:
        rig = None if record.calibration is None else Rig.from_dict(record.calibration)
    except DuofringeError as error:
        raise CaptureError(f"{folder / RECORD_NAME}: {error}") from error
    truth = _read_truth(folder) if with_truth else None
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
        for side, images in capture.images.items():
            (partial / side).mkdir()
            for pattern in capture.plan.patterns:
                _write_image(partial / side / f"{pattern.name}.png", images[pattern.name])
        if capture.truth is not None:
            _write_truth(capture.truth, partial / "truth")
        (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")


def _read_record(folder: Path) -> CaptureRecord | None:
    path = folder / RECORD_NAME
    if not path.exists():
        return None
    try:
        return CaptureRecord.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "content"
        raise CaptureError(f"{path}: {where}: {first['msg']}") from error
    except (OSError, ValueError) as error:
        raise CaptureError(f"{path}: not readable as JSON ({error})") from error


def _plan_of(folder: Path, record: CaptureRecord | None) -> PatternPlan:
    """The recorded plan, or default parameters for whatever known names stand in the folder."""
    if record is not None and record.patterns:
        return PatternPlan(name=record.plan, patterns=record.patterns)
    patterns = []
    for path in sorted((folder / "left").glob("*.png")):
        try:
            patterns.append(make_pattern(path.stem))
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
    for kind in sorted(plan.kinds):
        members = plan.of_kind(kind)
        first = members[0]
        count = first.steps if first.is_fringe else first.bits if first.is_gray else 1
        present = {p.step if first.is_fringe else p.bit if first.is_gray else 0 for p in members}
        missing += [f"{side}/{kind}_{i:02d}.png" for side in sides for i in range(count or 1) if i not in present]
    if missing:
        shown = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
        raise CaptureError(f"{folder}: damaged capture: lacks {shown}; restore the files or capture again")


def _read_image(path: Path) -> Image:
    image = (
        cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED) if path.stat().st_size else None
    )
    if image is None or not _png_is_whole(path):
        raise CaptureError(f"{path}: not a whole PNG (truncated or damaged); restore it or capture again")
    if image.ndim != 2:
        raise CaptureError(
            f"{path}: has {image.shape[2]} channels; captures hold single-channel PNGs; "
            "'duofringe import' takes one channel of a colour set"
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise CaptureError(f"{path}: has {image.dtype} pixels; captures hold 8- or 16-bit PNGs")
    return image  # type: ignore[return-value]  # the pixel type was checked above


def _png_is_whole(path: Path) -> bool:
    """OpenCV fills what a truncated PNG lacks with grey and says nothing; the closing chunk tells."""
    with path.open("rb") as file:
        file.seek(-min(64, path.stat().st_size), 2)
        return b"IEND" in file.read()


def _write_image(path: Path, image: Image) -> None:
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION]):
        raise CaptureError(f"{path}: could not be written")


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
    depths = {16 if image.dtype == np.uint16 else 8 for by_name in images.values() for image in by_name.values()}
    if len(depths) > 1:
        raise CaptureError(f"{folder}: mixes 8-bit and 16-bit images; a capture has one bit depth")
    if record is not None:
        if depths and record.bit_depth > max(depths):
            raise CaptureError(
                f"{folder / RECORD_NAME}: bit_depth is {record.bit_depth} but the images have {max(depths)} bits"
            )
        return record
    return CaptureRecord(id=folder.name, bit_depth=max(depths, default=8))


def _read_truth(folder: Path) -> Truth | None:
    directory = folder / "truth"
    if not directory.is_dir():
        return None
    try:
        depth = np.load(directory / "depth.npy", allow_pickle=False)
        column = np.load(directory / "projector_column.npy", allow_pickle=False)
        foreground = _read_image(directory / "foreground.png") > 0
        names = {p.stem: p for p in sorted(directory.glob("*.npy")) if p.stem not in ("depth", "projector_column")}
        extra = {name: np.load(path, allow_pickle=False) for name, path in names.items()}
    except (OSError, ValueError) as error:
        raise CaptureError(f"{directory}: truth is not readable ({error})") from error
    if not depth.shape == column.shape == foreground.shape:
        raise CaptureError(f"{directory}: depth, projector_column and foreground differ in size")
    return Truth(depth.astype(np.float32), column.astype(np.float32), foreground, extra)


def _write_truth(truth: Truth, directory: Path) -> None:
    directory.mkdir()
    np.save(directory / "depth.npy", truth.depth.astype(np.float32))
    np.save(directory / "projector_column.npy", truth.projector_column.astype(np.float32))
    _write_image(directory / "foreground.png", truth.foreground.astype(np.uint8) * np.uint8(255))
    for name, array in truth.extra.items():
        np.save(directory / f"{name}.npy", array)
