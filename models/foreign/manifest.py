"""The manifest of a foreign set: every fact that a decoder needs and the files do not tell.

docs/foreign-captures.md lists the keys."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from models.errors import ManifestError
from models.foreign.files import FileNames, Slot, expand_order, parse_file_names
from models.geometry.opencv_files import FIELDS
from models.geometry.rig import Side

SCHEMA: Literal["foreign-set/1"] = "foreign-set/1"
MAXIMUM_MANIFEST_BYTES = 1 << 20
MAXIMUM_IMAGES_PER_VIEW = 256
_SHIFT_TOLERANCE_RAD = 1e-3
MILLIMETRES: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}

Positive = Annotated[FiniteFloat, Field(gt=0)]
Names = Annotated[FileNames, BeforeValidator(parse_file_names)]
Pair = Annotated[tuple[FiniteFloat, FiniteFloat], Field(strict=False)]


class _Table(BaseModel):
    """A TOML table: unknown keys are errors, and values are taken as they are typed."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True)


class Views(_Table):
    """What ``{view}`` stands for in the file names of each camera; ``right`` is left out for a one-camera set."""

    left: str = "left"
    right: str | None = None

    @property
    def words(self) -> dict[Side, str]:
        words: dict[Side, str] = {"left": self.left}
        if self.right is not None:
            words["right"] = self.right
        return words


class ImageFormat(_Table):
    """How pixels are read. ``bit_depth`` must be told for 16-bit files; ``white_level`` defaults to 2^bit_depth - 1."""

    channel: Literal["gray", "red", "green", "blue"] = "gray"
    bit_depth: int | None = Field(None, ge=8, le=16)
    white_level: int | None = Field(None, ge=1, le=65535)


class Sequence(_Table):
    """Files that are named by nothing but their order: sorted naturally, they are taken group by group."""

    files: str
    order: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]


class SingleImage(_Table):
    file: Names | None = None

    @property
    def names(self) -> FileNames | None:
        return self.file


class CompositeImage(SingleImage):
    """The single exposure that carries both fringes; its parameters default to those of ``high`` and ``low``."""

    periods: Pair | None = None
    phase_offsets: Pair | None = None


class NumberedGroup(_Table):
    files: Names | None = None
    first: int = Field(0, ge=0)
    stride: int = 1

    @property
    def names(self) -> FileNames | None:
        return self.files

    @model_validator(mode="after")
    def _stride_moves(self) -> NumberedGroup:
        if self.stride == 0:
            raise ValueError("stride is 0; files must differ")
        return self


class FringeSteps(NumberedGroup):
    """An N-step set: I_k = A + B cos(2 pi u / period - phase_offset - shift_sign 2 pi k / steps)."""

    steps: int = Field(ge=3, le=MAXIMUM_IMAGES_PER_VIEW)
    period: Positive
    shift_sign: Literal[1, -1] = 1
    phase_offset: FiniteFloat = 0.0
    shifts_deg: Annotated[tuple[FiniteFloat, ...], Field(strict=False)] | None = None

    @model_validator(mode="after")
    def _shifts_are_uniform(self) -> FringeSteps:
        if self.shifts_deg is None:
            return self
        if len(self.shifts_deg) != self.steps:
            raise ValueError(f"shifts_deg has {len(self.shifts_deg)} values but steps is {self.steps}")
        order, first = self._ordered_shifts()
        for k, index in enumerate(order):
            excess = math.radians(self.shifts_deg[index]) * self.shift_sign - first - 2 * math.pi * k / self.steps
            if abs(math.remainder(excess, 2 * math.pi)) > _SHIFT_TOLERANCE_RAD:
                raise ValueError(
                    f"shifts_deg {list(self.shifts_deg)} are not uniform steps of {360 / self.steps:g} degrees; "
                    "only uniform N-step sets over one period are decoded"
                )
        return self

    def _ordered_shifts(self) -> tuple[list[int], float]:
        """File indices by rising shift, and the smallest shift in radians, 0 <= shift < 2 pi."""
        assert self.shifts_deg is not None
        shifts = [math.radians(s) * self.shift_sign % (2 * math.pi) for s in self.shifts_deg]
        # A shift of 360 degrees less a rounding error is a shift of zero.
        shifts = [0.0 if 2 * math.pi - s < _SHIFT_TOLERANCE_RAD else s for s in shifts]
        order = sorted(range(len(shifts)), key=shifts.__getitem__)
        return order, shifts[order[0]]

    def normalised(self) -> tuple[list[int], Literal[1, -1], float]:
        """File index of each step k, shift sign, and phase offset in radians.

        A list of shifts is put in rising order, so that its sign is +1 and its smallest shift joins the offset.
        """
        if self.shifts_deg is None:
            return list(range(self.steps)), self.shift_sign, self.phase_offset
        order, first = self._ordered_shifts()
        return order, 1, self.phase_offset + first


class GrayPlanes(NumberedGroup):
    """Gray-code planes. ``period`` is the width of one code word: the high fringe's, or half of it for a code that is
    one bit finer (the "complementary bit" that settles the fringe's borders)."""

    bits: int = Field(ge=1, le=16)
    bit_order: Literal["msb_first", "lsb_first"] = "msb_first"
    polarity: Literal["normal", "inverted"] = "normal"
    period: Positive | None = None
    inverse_files: Names | None = None
    inverse_first: int = Field(0, ge=0)


class CalibrationFiles(_Table):
    """``calibration.json`` or OpenCV FileStorage files; ``fields`` names what is not called as OpenCV's samples do."""

    files: Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=8)]
    fields: dict[str, str] = Field(default_factory=dict)
    units: Literal["mm", "cm", "m", "in"] = "mm"
    size: Annotated[tuple[int, int], Field(strict=False)] | None = None

    @model_validator(mode="after")
    def _known_fields(self) -> CalibrationFiles:
        unknown = sorted(set(self.fields) - set(FIELDS))
        if unknown:
            raise ValueError(f"unknown field '{unknown[0]}'; known are {', '.join(FIELDS)}")
        return self


class Manifest(_Table):
    """Description of one foreign set. Periods share one unit, projector columns where these are known."""

    schema_: Literal["foreign-set/1"] = Field(alias="schema")
    name: str | None = Field(None, min_length=1, max_length=128)
    object_id: str | None = Field(None, min_length=1, max_length=128)
    views: Views = Views()
    images: ImageFormat = ImageFormat()
    sequence: Sequence | None = None
    white: SingleImage | None = None
    black: SingleImage | None = None
    composite: CompositeImage | None = None
    high: FringeSteps | None = None
    low: FringeSteps | None = None
    gray: GrayPlanes | None = None
    calibration: CalibrationFiles | None = None

    @model_validator(mode="after")
    def _groups_belong_together(self) -> Manifest:
        if self.low is not None and self.high is None:
            raise ValueError("low stands without high; call the only carrier of a set 'high'")
        if self.high is None and not self.has_composite:
            raise ValueError("neither 'high' nor 'composite' is described; a set needs fringes")
        if self.has_composite:
            self.composite_periods()
        if self.gray is not None and self.gray.period is None and self.high is None:
            raise ValueError("gray.period is required where no 'high' group gives the width of a code word")
        return self

    @model_validator(mode="after")
    def _each_group_has_its_files_once(self) -> Manifest:
        counts = self.group_sizes()
        ordered = {slot.group for slot in self.sequence_slots()}
        for group in counts:
            if (self.names_of(group) is not None) == (group in ordered):
                fault = "has files and stands in sequence.order; keep one" if group in ordered else "has no files"
                raise ValueError(f"{group}: {fault}")
        if sum(counts.values()) > MAXIMUM_IMAGES_PER_VIEW:
            raise ValueError(f"describes more than {MAXIMUM_IMAGES_PER_VIEW} images a view")
        return self

    @property
    def has_composite(self) -> bool:
        return self.composite is not None or (self.sequence is not None and "composite" in self.sequence.order)

    def composite_periods(self) -> tuple[float, float]:
        """Periods of the composite's high and low fringe."""
        if self.composite is not None and self.composite.periods is not None:
            return self.composite.periods
        if self.high is None or self.low is None:
            raise ValueError("composite.periods is required where 'high' and 'low' are not both described")
        return self.high.period, self.low.period

    def composite_offsets(self) -> tuple[float, float]:
        """Phase offsets of the composite's high and low fringe, radians."""
        if self.composite is not None and self.composite.phase_offsets is not None:
            return self.composite.phase_offsets
        return (
            self.high.phase_offset if self.high is not None else 0.0,
            self.low.phase_offset if self.low is not None else 0.0,
        )

    def group_sizes(self) -> dict[str, int]:
        """Number of images a view of each group, in exposure order; ``gray_inv`` is a group of its own."""
        ordered = set(self.sequence.order) if self.sequence is not None else set()
        sizes: dict[str, int] = {}
        if self.white is not None or "white" in ordered:
            sizes["white"] = 1
        if self.has_composite:
            sizes["composite"] = 1
        if self.high is not None:
            sizes["high"] = self.high.steps
        if self.low is not None:
            sizes["low"] = self.low.steps
        if self.gray is not None:
            sizes["gray"] = self.gray.bits
            if self.gray.inverse_files is not None or any(word.startswith("gray_inv") for word in ordered):
                sizes["gray_inv"] = self.gray.bits
        if self.black is not None or "black" in ordered:
            sizes["black"] = 1
        return sizes

    def names_of(self, group: str) -> FileNames | None:
        """File names that the manifest gives for a group; None where the sequence holds it."""
        if group == "gray_inv":
            return self.gray.inverse_files if self.gray is not None else None
        table = getattr(self, group)
        return None if table is None else table.names

    def sequence_slots(self) -> list[Slot]:
        """What each file of the sequence is, in order; empty without a sequence."""
        return [] if self.sequence is None else expand_order(self.sequence.order, self.group_sizes())


def read_manifest(path: Path) -> Manifest:
    """Read and validate a manifest; raises ManifestError naming the file and the key at fault."""
    try:
        if path.stat().st_size > MAXIMUM_MANIFEST_BYTES:
            raise ManifestError(f"manifest '{path}' is larger than {MAXIMUM_MANIFEST_BYTES >> 20} MiB")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ManifestError(f"manifest '{path}' does not exist") from error
    except OSError as error:
        raise ManifestError(f"manifest '{path}' is not readable ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise ManifestError(f"{path}: not valid TOML ({_one_line(error)})") from error
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        raise ManifestError(f"{path}: {_describe(error)}") from error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _describe(error: ValidationError) -> str:
    errors = error.errors(include_url=False)
    # A misspelt key also makes the right one missing: the misspelling is the better message.
    first = min(errors, key=lambda e: e["type"] != "extra_forbidden")
    where = ".".join(str(part) for part in first["loc"])
    message = {"extra_forbidden": "unknown key", "missing": "is required"}.get(first["type"], first["msg"])
    message = message.removeprefix("Value error, ")
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return f"{where}: {message}{more}" if where else f"{message}{more}"
