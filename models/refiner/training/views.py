"""Views made ready for training: the single-shot estimate of each is computed once and kept on disk.

A view is one float16 file of planes and, where there are labels, one float32 file of projector columns. Reading a
crop of it touches only that crop's pages, so any number of captures serves.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from models.atomic import write_text_atomically
from models.capture import Capture, read_capture
from models.errors import CalibrationError
from models.geometry.rig import Rig, Side
from models.phase.wft import WindowedFourierTransform
from models.refiner.errors import RefinerError

Columns = Callable[[Capture, Rig], Mapping[Side, npt.NDArray[np.float32]]]
"""Projector column u (H, W) of each view: NaN where it is known that there is no phase, inf where nothing is known."""
MANIFEST_NAME = "views.json"
_VERSION = 2


@dataclass(frozen=True)
class View:
    """A prepared view. planes: .npy float16 (6, H, W): image, texture, real and imaginary part of the high and of the
    low carrier, shares of the white level. columns: .npy float32 (H, W) as ``Columns``, or None. sign: +1 where the
    projector's columns grow along the image's rows, else -1. sha256: of the image and of the columns.
    """

    name: str
    planes: Path
    columns: Path | None
    sign: int
    periods: tuple[float, float]
    size: tuple[int, int]
    sha256: str


def prepare_views(
    captures: Sequence[Path],
    folder: Path,
    *,
    fallback_rig: Rig | None = None,
    columns: Columns | None = None,
    source: str = "none",
    progress: Callable[[int, int], None] | None = None,
) -> list[View]:
    """Prepare both views of every capture, or take what an earlier call prepared for the same captures.

    folder: of the prepared files, created. columns: makes the labels, None where there are none; truth is read only
    then. source: tells kinds of labels apart. Raises CaptureError or CalibrationError for a capture that cannot serve.
    """
    key = hashlib.sha256(json.dumps([_VERSION, source, [str(path) for path in captures]]).encode()).hexdigest()
    manifest = folder / MANIFEST_NAME
    if (known := _prepared(manifest, key)) is not None:
        return known
    folder.mkdir(parents=True, exist_ok=True)
    views: list[View] = []
    for number, path in enumerate(captures):
        views.extend(_prepare(path, folder, number, fallback_rig, columns))
        if progress is not None:
            progress(number + 1, len(captures))
    record = {"key": key, "views": [_as_json(view) for view in views]}
    write_text_atomically(manifest, json.dumps(record) + "\n")
    return views


def _prepare(path: Path, folder: Path, number: int, fallback_rig: Rig | None, columns: Columns | None) -> list[View]:
    capture = read_capture(path, kinds={"composite"}, with_truth=columns is not None)
    rig = capture.rig or fallback_rig
    if rig is None:
        raise CalibrationError(f"{path}: has no calibration, and neither has the dataset")
    wft = WindowedFourierTransform(rig)
    capture.require(wft.required_kinds(), "training")
    periods = capture.plan.of_kind("composite")[0].periods
    if len(periods) != 2:
        raise RefinerError(f"{path}: the composite has {len(periods)} carriers; the refiner needs two")
    labels = None if columns is None else columns(capture, rig)
    views = []
    for side in capture.sides:
        image = torch.from_numpy(capture.stack(side, "composite"))
        field = wft.field(side, image[0], periods)
        carriers, texture = wft.separate_views(image, [field], periods)
        planes = torch.stack([image[0], texture[0], *torch.view_as_real(carriers[0]).movedim(-1, 1).flatten(0, 1)])
        stem = folder / f"view-{number:05d}-{side}"
        np.save(stem.with_suffix(".npy"), planes.numpy().astype(np.float16))
        digest = hashlib.sha256(image.numpy().tobytes())
        told = None
        if labels is not None:
            told = stem.with_name(f"{stem.name}-columns.npy")
            np.save(told, labels[side].astype(np.float32))
            digest.update(labels[side].tobytes())
        height, width = image.shape[-2:]
        sign = 1 if field.sign > 0 else -1
        views.append(
            View(
                f"{path.name}/{side}",
                stem.with_suffix(".npy"),
                told,
                sign,
                (periods[0], periods[1]),
                (width, height),
                digest.hexdigest(),
            )
        )
    return views


def _as_json(view: View) -> dict[str, object]:
    columns = None if view.columns is None else view.columns.name
    return {**view.__dict__, "planes": view.planes.name, "columns": columns}


def _prepared(manifest: Path, key: str) -> list[View] | None:
    try:
        record = json.loads(manifest.read_text(encoding="utf-8"))
        if record["key"] != key:
            return None
        views = []
        for entry in record["views"]:
            columns = None if entry["columns"] is None else manifest.parent / entry["columns"]
            pair = (float(entry["periods"][0]), float(entry["periods"][1]))
            size = (int(entry["size"][0]), int(entry["size"][1]))
            planes = manifest.parent / entry["planes"]
            views.append(View(entry["name"], planes, columns, int(entry["sign"]), pair, size, str(entry["sha256"])))
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return None
    return views


def truth_columns(capture: Capture, rig: Rig) -> dict[Side, npt.NDArray[np.float32]]:
    """Labels of a simulated capture: the column that each pixel's ray meets, NaN where the lamp does not light it.

    Raises RefinerError for a capture without truth of both views.
    """
    truth = capture.truth
    if truth is None:
        raise RefinerError(f"{capture.source}: has no truth/; train on a simulated dataset, or use --labels none")
    right = truth.extra.get("right_projector_column")
    lit = truth.extra.get("lit")
    if right is None or lit is None:
        missing = "right_projector_column" if right is None else "lit"
        raise RefinerError(f"{capture.source}: truth/ lacks {missing}; simulate the dataset anew, or use --labels none")
    left = np.where(lit.astype(bool), truth.projector_column, np.float32(np.nan))
    return {"left": left.astype(np.float32), "right": right.astype(np.float32)}
