"""Weights on disk: a folder with ``refiner.safetensors`` and ``refiner.json``, bound together by a checksum.

Safetensors hold numbers and names only; reading them runs no code, whoever wrote them. The numbers are float16: half
the size, and what rounding changes in a phase is far below its noise (docs/decisions/0019).
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load, save

from models.atomic import atomic_folder
from models.refiner.configuration import RefinerConfiguration
from models.refiner.errors import RefinerError
from models.refiner.network import Refiner

TENSORS_NAME = "refiner.safetensors"
RECORD_NAME = "refiner.json"
STORED = torch.float16
LARGEST_TENSORS = 64 << 20
LARGEST_RECORD = 1 << 20
Variant = Literal["label-free", "sim", "sim+adapt"]
"""What the weights learned from: the paper's losses, the simulator's phases, or these and then the losses."""


class WeightsRecord(BaseModel):
    """``refiner.json``. periods: of the high and the low carrier, projector columns. training: whatever the training
    wants remembered (split, steps, losses, seeds). foretells_certainty: whether the lengths of its phasors tell how
    sure it is (``phasor_loss``). sha256: of ``refiner.safetensors``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    schema_: Literal["refiner-weights/1"] = Field(default="refiner-weights/1", alias="schema")
    configuration: RefinerConfiguration
    periods: tuple[Annotated[float, Field(gt=1)], Annotated[float, Field(gt=1)]]
    variant: Variant
    training: dict[str, JsonValue] = Field(default_factory=dict)
    foretells_certainty: bool = False
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]

    def require_periods(self, periods: tuple[float, ...], folder: Path) -> None:
        """Raise RefinerError unless the weights are for fringes of these periods."""
        if tuple(periods) != self.periods:
            raise RefinerError(
                f"{folder}: weights are for fringes of {_columns(self.periods)} columns, not {_columns(periods)}; "
                "choose weights trained with the capture's periods, or adapt these: duofringe train CAPTURES --adapt"
            )

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


def save_weights(
    folder: Path,
    refiner: Refiner,
    periods: tuple[float, float],
    variant: Variant,
    training: dict[str, Any] | None = None,
    *,
    foretells_certainty: bool = False,
) -> WeightsRecord:
    """Write a new folder, whole or not at all, and return its record. Weights are rounded to float16.

    training: JSON values. Raises RefinerError for a record that JSON or its schema cannot hold and for weights that
    are not finite, DuofringeError where the folder exists.
    """
    tensors = {name: value.detach().cpu().to(STORED).contiguous() for name, value in refiner.state_dict().items()}
    _require_finite(tensors, folder)
    content = save(tensors)
    try:
        record = WeightsRecord(
            configuration=refiner.configuration,
            periods=periods,
            variant=variant,
            training=training or {},
            foretells_certainty=foretells_certainty,
            sha256=hashlib.sha256(content).hexdigest(),
        )
    except ValidationError as error:
        raise RefinerError(f"{folder}: {_first(error)}") from error
    with atomic_folder(folder) as partial:
        (partial / TENSORS_NAME).write_bytes(content)
        (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")
    return record


def load_weights(folder: Path, periods: tuple[float, ...] | None = None) -> tuple[Refiner, WeightsRecord]:
    """The refiner of a folder, on the CPU and in evaluation mode, and its record.

    periods: of the captures it is to refine; None takes any. Raises RefinerError for a folder that is damaged, of
    another version, not of this network, or trained for other periods.
    """
    record = _read_record(folder / RECORD_NAME)
    if periods is not None:
        record.require_periods(periods, folder)
    path = folder / TENSORS_NAME
    content = _read(path, LARGEST_TENSORS)
    if hashlib.sha256(content).hexdigest() != record.sha256:
        raise RefinerError(f"{path}: is not the file that {RECORD_NAME} describes (sha256 differs); copy both again")
    try:
        tensors = load(content)
    except (SafetensorError, ValueError, KeyError) as error:
        raise RefinerError(f"{path}: not readable as safetensors ({_line(error)}); copy the folder again") from error
    refiner = Refiner(record.configuration)
    _require_shapes(tensors, refiner, path)
    _require_finite(tensors, path)
    refiner.load_state_dict(tensors)
    return refiner.eval(), record


def _read_record(path: Path) -> WeightsRecord:
    try:
        content = json.loads(_read(path, LARGEST_RECORD))
    except (ValueError, RecursionError) as error:
        raise RefinerError(f"{path}: not readable as JSON ({_line(error)}); copy the folder again") from error
    try:
        return WeightsRecord.model_validate(content)
    except ValidationError as error:
        raise RefinerError(f"{path}: {_first(error)}; these weights are not for this version") from error


def _read(path: Path, largest: int) -> bytes:
    try:
        if not path.is_file():
            raise RefinerError(f"{path}: missing; weights are a folder with {TENSORS_NAME} and {RECORD_NAME}")
        size = path.stat().st_size
        if size > largest:
            raise RefinerError(f"{path}: {size} bytes, more than the {largest} of any refiner; name another folder")
        return path.read_bytes()
    except OSError as error:
        raise RefinerError(f"{path}: not readable ({error.strerror}); check its permissions") from error


def _require_shapes(tensors: dict[str, torch.Tensor], refiner: Refiner, path: Path) -> None:
    expected = refiner.state_dict()
    if strange := sorted(expected.keys() ^ tensors.keys()):
        raise RefinerError(
            f"{path}: weight '{strange[0]}' is {'missing' if strange[0] in expected else 'unknown'} "
            f"({len(strange)} such); the file is not of the network in {RECORD_NAME}"
        )
    for name, value in tensors.items():
        wanted = expected[name]
        if value.shape != wanted.shape or value.dtype != STORED:
            raise RefinerError(
                f"{path}: weight '{name}' is {value.dtype} {tuple(value.shape)}, the network has {STORED} "
                f"{tuple(wanted.shape)}; the file is not of the network in {RECORD_NAME}"
            )


def _require_finite(tensors: dict[str, torch.Tensor], where: Path) -> None:
    for name, value in tensors.items():
        if not bool(value.isfinite().all()):
            raise RefinerError(f"{where}: weight '{name}' is not finite; the training diverged, take an earlier state")


def _columns(periods: tuple[float, ...]) -> str:
    return " and ".join(f"{period:g}" for period in periods)


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc']) or 'content'}: {first['msg']}"


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
