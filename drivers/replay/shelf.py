"""Which recorded captures of a folder can be replayed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DeviceNotFoundError
from models.capture import read_outline
from models.dataset import open_dataset
from models.errors import DatasetError, DuofringeError
from models.geometry.rig import Rig

NAME = "replay"
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(frozen=True, eq=False)
class Shelf:
    """Captures by name, in name order. rig: calibration that a dataset states for all. warnings: what was left out."""

    folder: Path
    captures: Mapping[str, Path]
    rig: Rig | None
    warnings: tuple[str, ...]


def scan(folder: Path) -> Shelf:
    """Look through a capture folder, a folder of them, or a dataset, without reading pixels.

    Captures that are damaged or have one view are left out, with a warning each. Raises DeviceNotFoundError where
    nothing usable is there.
    """
    try:
        dataset = open_dataset(folder)
    except DatasetError as error:
        raise DeviceNotFoundError(NAME, str(error)) from error
    usable: dict[str, Path] = {}
    warnings: list[str] = []
    for name, path in sorted(dataset.samples.items()):
        fault = _fault_of(path)
        if fault is None:
            usable[name] = path
        else:
            warnings.append(f"capture '{name}' is left out of the replay: {fault}")
    if not usable:
        raise DeviceNotFoundError(NAME, f"'{folder}' has no usable capture; {warnings[0]}")
    return Shelf(Path(folder), usable, dataset.rig, tuple(warnings))


def _fault_of(path: Path) -> str | None:
    """Why a capture cannot be replayed, as far as can be told without decoding its images."""
    try:
        outline = read_outline(path)
        if outline.record is not None and outline.record.calibration is not None:
            Rig.from_dict(outline.record.calibration)
        if "right" not in outline.sides:
            return "it has one view; a rig has two"
        images = [path / side / f"{pattern.name}.png" for side in outline.sides for pattern in outline.plan.patterns]
        return next((f"{image} is truncated" for image in images if not _ends_well(image)), None)
    except DuofringeError as error:
        return str(error)
    except OSError as error:
        return f"not readable ({error})"


def _ends_well(png: Path) -> bool:
    with png.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - len(_PNG_END)))
        return file.read() == _PNG_END
