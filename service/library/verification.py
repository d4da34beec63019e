"""A capture folder of unknown origin, checked as a whole with one image in memory at a time."""

from __future__ import annotations

import json
from pathlib import Path

from models.capture import RECORD_NAME, CaptureOutline, CaptureRecord, read_capture, read_outline
from models.errors import CaptureError
from models.npy import npy_header
from models.png import PngHeader, png_header, read_png

_MIB = 2**20


def verify_capture(folder: Path, pixel_bytes: int) -> CaptureOutline:
    """Check everything that ``read_capture`` checks; images that the plan does not name are removed.

    pixel_bytes: what all images may take, decoded. Raises CaptureError.
    """
    outline = read_outline(folder)
    _remove_strangers(folder, outline)
    headers = _check_headers(folder, outline, pixel_bytes)
    depth = next(iter(headers.values())).bit_depth
    record = outline.record
    stated = record.bit_depth if record is not None and "bit_depth" in record.model_fields_set else depth
    if stated > max(depth, 8):
        raise CaptureError(f"{folder / RECORD_NAME}: bit_depth is {stated} but the images have {depth} bits")
    for path in headers:
        highest = int(read_png(path).max())
        if highest >= 2 ** max(stated, 1):
            raise CaptureError(f"{path}: reaches {highest} but bit_depth is {stated} in {RECORD_NAME}")
    _check_truth(folder / "truth", outline)
    read_capture(folder, kinds=(), with_truth=False)  # the calibration, and what else needs no pixels
    return outline


def settle_record(folder: Path, new_id: str, outline: CaptureOutline) -> None:
    """Write the record of a checked capture anew, complete and under its new id; raises CaptureError."""
    first = png_header(folder / "left" / f"{outline.plan.names[0]}.png")
    record = outline.record or CaptureRecord()
    update: dict[str, object] = {"id": new_id, "plan": outline.plan.name, "patterns": outline.plan.patterns}
    if "bit_depth" not in record.model_fields_set:
        update["bit_depth"] = 16 if first.bit_depth == 16 else 8
    if record.id:
        update["imported_id"] = record.id
    try:
        text = record.model_copy(update=update).to_json()
        CaptureRecord.model_validate(json.loads(text))
        content = text.encode("utf-8")
    except (ValueError, RecursionError) as error:
        raise CaptureError(f"{folder / RECORD_NAME}: holds what JSON cannot hold") from error
    (folder / RECORD_NAME).write_bytes(content)


def _remove_strangers(folder: Path, outline: CaptureOutline) -> None:
    for side in ("left", "right"):
        for path in (folder / side).glob("*.png"):
            if side not in outline.sides or path.stem not in outline.plan.names:
                path.unlink()


def _check_headers(folder: Path, outline: CaptureOutline, pixel_bytes: int) -> dict[Path, PngHeader]:
    headers: dict[Path, PngHeader] = {}
    for side in outline.sides:
        own = {path: png_header(path) for path in (folder / side / f"{name}.png" for name in outline.plan.names)}
        sizes = {(h.width, h.height) for h in own.values()}
        if len(sizes) > 1:
            raise CaptureError(f"{folder / side}: its images differ in size; all images of a view have one size")
        headers |= own
    if len({h.bit_depth == 16 for h in headers.values()}) > 1:
        raise CaptureError(f"{folder}: mixes 8-bit and 16-bit images; a capture has one bit depth")
    if sum(h.width * h.height * max(1, h.bit_depth // 8) for h in headers.values()) > pixel_bytes:
        raise CaptureError(f"{folder}: its images take more than {pixel_bytes // _MIB} MiB when they are decoded")
    return headers


def _check_truth(directory: Path, outline: CaptureOutline) -> None:
    """Truth is there as a whole and fits the left images; its values are any numbers, so they need not be read."""
    if not directory.is_dir():
        return
    width, height = outline.size
    for name in ("depth", "projector_column"):
        if npy_header(directory / f"{name}.npy").shape != (height, width):
            raise CaptureError(f"{directory / name}.npy: does not have the size of the left images")
    for path in directory.glob("*.npy"):
        npy_header(path)
    mask = read_png(directory / "foreground.png")
    if mask.shape != (height, width):
        raise CaptureError(f"{directory / 'foreground.png'}: does not have the size of the left images")
