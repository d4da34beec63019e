"""States of a training on disk: folders that are whole or absent, each enough to go on to the same weights."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load, save

from models.atomic import atomic_folder
from models.refiner.errors import RefinerError
from models.refiner.network import Refiner
from models.refiner.training.configuration import TrainingConfiguration

TENSORS_NAME = "state.safetensors"
RECORD_NAME = "state.json"
_PREFIX = "step-"
_KEPT = 2


class CheckpointRecord(BaseModel):
    """``state.json``. step: how many steps are done. seconds: spent so far. parent: of the weights it began from."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    schema_: Literal["refiner-checkpoint/1"] = Field(default="refiner-checkpoint/1", alias="schema")
    configuration: TrainingConfiguration
    step: Annotated[int, Field(ge=0)]
    seconds: Annotated[float, Field(ge=0)]
    data: str
    parent: str | None = None
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """record, and every tensor by name: ``network.*``, ``first.*`` and ``second.*`` moments of the optimiser."""

    record: CheckpointRecord
    tensors: dict[str, torch.Tensor]


def write_checkpoint(
    folder: Path,
    refiner: Refiner,
    optimiser: torch.optim.AdamW,
    configuration: TrainingConfiguration,
    *,
    step: int,
    seconds: float,
    data: str,
    parent: str | None,
) -> None:
    """Add ``step-N`` to ``folder`` and keep the newest two. data: digest of the captures trained on."""
    tensors = {f"network.{name}": value.detach().contiguous() for name, value in refiner.state_dict().items()}
    for name, parameter in refiner.named_parameters():
        state = optimiser.state.get(parameter)
        if state:
            tensors[f"first.{name}"] = state["exp_avg"].contiguous()
            tensors[f"second.{name}"] = state["exp_avg_sq"].contiguous()
    folder.mkdir(parents=True, exist_ok=True)
    content = save({name: value.cpu() for name, value in tensors.items()})
    digest = hashlib.sha256(content).hexdigest()
    record = CheckpointRecord(
        configuration=configuration, step=step, seconds=seconds, data=data, parent=parent, sha256=digest
    )
    with atomic_folder(folder / f"{_PREFIX}{step:08d}", durable=False) as partial:
        (partial / TENSORS_NAME).write_bytes(content)
        (partial / RECORD_NAME).write_text(record.model_dump_json(by_alias=True, indent=2) + "\n", encoding="utf-8")
    for old in _steps(folder)[:-_KEPT]:
        shutil.rmtree(old)


def read_checkpoint(path: Path) -> Checkpoint:
    """The state in a ``step-N`` folder (or a file of it), or the newest in a training's folder.

    Raises RefinerError where there is none or it is damaged.
    """
    if path.is_file():
        path = path.parent
    if not (path / RECORD_NAME).is_file():
        found = _steps(path) or _steps(path / "checkpoints")
        if not found:
            raise RefinerError(f"{path}: holds no state of a training; name the folder that ends in .training")
        path = found[-1]
    try:
        record = CheckpointRecord.model_validate_json((path / RECORD_NAME).read_text(encoding="utf-8"))
        content = (path / TENSORS_NAME).read_bytes()
        if hashlib.sha256(content).hexdigest() != record.sha256:
            raise RefinerError(f"{path / TENSORS_NAME}: is damaged (sha256 differs); go on from an earlier state")
        return Checkpoint(record, load(content))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise RefinerError(f"{path / RECORD_NAME}: {where}: {first['msg']}; train anew with this version") from error
    except (OSError, UnicodeDecodeError, SafetensorError) as error:
        raise RefinerError(f"{path}: not readable ({error}); go on from an earlier state") from error


def restore(checkpoint: Checkpoint, refiner: Refiner, optimiser: torch.optim.AdamW) -> None:
    """Put a state into a network and its optimiser. Raises RefinerError where they do not fit."""
    tensors, step = checkpoint.tensors, float(checkpoint.record.step)
    try:
        refiner.load_state_dict({n.removeprefix("network."): v for n, v in tensors.items() if n.startswith("network.")})
        for name, parameter in refiner.named_parameters():
            if step:
                optimiser.state[parameter] = {
                    "step": torch.tensor(step),
                    "exp_avg": _like(tensors[f"first.{name}"], parameter),
                    "exp_avg_sq": _like(tensors[f"second.{name}"], parameter),
                }
    except (KeyError, RuntimeError) as error:
        raise RefinerError(f"the state does not fit the network of its own record ({error}); train anew") from error


def _like(values: torch.Tensor, parameter: torch.Tensor) -> torch.Tensor:
    """On the parameter's device and in its memory order, on which the last bit of sums may depend."""
    out = torch.empty_like(parameter, memory_format=torch.preserve_format, requires_grad=False)
    return out.copy_(values)


def _steps(folder: Path) -> list[Path]:
    return sorted(p for p in folder.glob(f"{_PREFIX}*") if (p / RECORD_NAME).is_file()) if folder.is_dir() else []


def canonical(data: object) -> str:
    """Digest of JSON-ready data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
