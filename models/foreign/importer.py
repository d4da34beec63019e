"""A recorded foreign set becomes a capture: our names, Gray planes most significant first, phases by our convention."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from models.capture import Capture, CaptureRecord, DeviceRecord, Image
from models.errors import CalibrationError, ManifestError
from models.foreign.files import group_files, resolve_file, sequence_files
from models.foreign.images import read_foreign_image
from models.foreign.manifest import MILLIMETRES, CalibrationFiles, FringeSteps, GrayPlanes, Manifest, read_manifest
from models.geometry.opencv_files import read_opencv_cameras
from models.geometry.rig import Rig, Side
from models.patterns import Pattern, PatternKind, PatternPlan


def import_capture(folder: Path | str, manifest: Path | str) -> Capture:
    """Read a foreign set into memory as a capture; ``models.capture.write_capture`` stores it.

    folder: where the set lies; no path of the manifest may lead out of it. manifest: TOML file
    (docs/foreign-captures.md). Fringe periods, shift sign and phase offset travel as pattern parameters; Gray planes
    are put most significant first and in normal polarity. The record keeps the manifest's SHA-256 and the name of each
    source file. Raises ManifestError or CalibrationError with the file and key at fault.
    """
    folder, manifest = Path(folder), Path(manifest)
    if not folder.is_dir():
        raise ManifestError(f"foreign set '{folder}' is not a folder")
    description = read_manifest(manifest)
    plan = make_foreign_plan(description)
    sources: dict[Side, dict[str, str]] = {}
    images: dict[Side, dict[str, Image]] = {}
    for side, word in description.views.words.items():
        try:
            sources[side] = _sources(description, folder, side, word)
            paths = {name: resolve_file(folder, file, name) for name, file in sources[side].items()}
        except ManifestError as error:
            raise ManifestError(f"{manifest}: {error}") from error
        images[side] = {p.name: read_foreign_image(paths[p.name], description.images.channel) for p in plan.patterns}
        _check_one_size(images[side], sources[side], folder)
    bit_depth, white_level = _scale(images, description, manifest)
    images = {s: _with_normal_polarity(by_name, description, white_level, manifest) for s, by_name in images.items()}
    first = next(iter(images["left"].values()))
    rig = _rig(description.calibration, folder, manifest, (first.shape[1], first.shape[0]))
    record = CaptureRecord(
        id=description.name or folder.resolve().name,
        plan=plan.name,
        patterns=plan.patterns,
        devices=tuple(DeviceRecord(role=side, driver="import", origin="imported") for side in images),
        settings={"import": _provenance(description, manifest, sources)},
        object_id=description.object_id,
        bit_depth=bit_depth,
        white_level=white_level,
    )
    return Capture(plan, images, rig, record, source=str(folder))


def make_foreign_plan(manifest: Manifest) -> PatternPlan:
    """Patterns of the set with the parameters that the manifest tells, in our exposure order."""
    sizes = manifest.group_sizes().items()
    patterns = tuple(_pattern(manifest, group, index) for group, count in sizes for index in range(count))
    return PatternPlan(name="imported", patterns=patterns)


def _pattern(manifest: Manifest, group: str, index: int) -> Pattern:
    if group in ("white", "black"):
        return Pattern(name=group, kind=_kind(group))
    if group == "composite":
        periods, offsets = manifest.composite_periods(), manifest.composite_offsets()
        return Pattern(name=group, kind="composite", period=periods, phase_offset=offsets)
    name = f"{group}_{index:02d}"
    table = getattr(manifest, "gray" if group == "gray_inv" else group)
    if isinstance(table, FringeSteps):
        _, sign, offset = table.normalised()
        return Pattern(
            name=name,
            kind=_kind(group),
            period=table.period,
            step=index,
            steps=table.steps,
            shift_sign=sign,
            phase_offset=offset,
        )
    assert isinstance(table, GrayPlanes)
    period = table.period
    if period is None:
        assert manifest.high is not None  # the manifest was validated
        period = manifest.high.period
    return Pattern(name=name, kind=_kind(group), period=period, bit=index, bits=table.bits)


def _kind(group: str) -> PatternKind:
    return group  # type: ignore[return-value]  # groups of a manifest are a subset of the kinds


def _sources(manifest: Manifest, folder: Path, side: Side, word: str) -> dict[str, str]:
    """Relative source file of every pattern of one view, by our pattern names."""
    files: dict[str, list[str]] = {}
    slots = manifest.sequence_slots()
    if manifest.sequence is not None:
        found = sequence_files(folder, manifest.sequence.files, word, slots)
        for slot in sorted(found, key=lambda s: s.index):
            files.setdefault(slot.group, []).append(found[slot])
    for group, count in manifest.group_sizes().items():
        names = manifest.names_of(group)
        if names is not None:
            numbers = _file_numbers(manifest, group, count)
            files[group] = group_files(names, side, word, group, numbers)
    result: dict[str, str] = {}
    for group, count in manifest.group_sizes().items():
        for index, position in enumerate(_positions(manifest, group, count)):
            name = group if group in ("white", "black", "composite") else f"{group}_{index:02d}"
            file = files[group][position]
            twin = next((other for other, taken in result.items() if taken == file), None)
            if twin is not None:
                raise ManifestError(f"file '{file}' is both {twin} and {name}; mend first, steps or bits")
            result[name] = file
    return result


def _file_numbers(manifest: Manifest, group: str, count: int) -> list[int]:
    if group == "gray_inv":
        assert manifest.gray is not None
        first, stride = manifest.gray.inverse_first, manifest.gray.stride
    else:
        table = getattr(manifest, group)
        first, stride = getattr(table, "first", 0), getattr(table, "stride", 1)
    return [first + stride * index for index in range(count)]


def _positions(manifest: Manifest, group: str, count: int) -> list[int]:
    """Position in the set's own order of each image in ours."""
    if group in ("gray", "gray_inv"):
        assert manifest.gray is not None
        positions = list(range(count))
        return positions[::-1] if manifest.gray.bit_order == "lsb_first" else positions
    table = getattr(manifest, group)
    return table.normalised()[0] if isinstance(table, FringeSteps) else list(range(count))


def _with_normal_polarity(
    images: dict[str, Image], manifest: Manifest, white_level: int, path: Path
) -> dict[str, Image]:
    """Planes in which bright means 0 are exchanged with their inverse, or mirrored about (white + black) / 2."""
    gray = manifest.gray
    if gray is None or gray.polarity == "normal":
        return images
    result = dict(images)
    if "gray_inv_00" in images:
        for bit in range(gray.bits):
            a, b = f"gray_{bit:02d}", f"gray_inv_{bit:02d}"
            result[a], result[b] = images[b], images[a]
        return result
    if "white" not in images or "black" not in images:
        raise ManifestError(
            f"{path}: gray.polarity: 'inverted' needs the white and black images, or the inverse planes"
        )
    twice_threshold = images["white"].astype(np.int64) + images["black"]
    for bit in range(gray.bits):
        plane = images[f"gray_{bit:02d}"]
        mirrored = np.clip(twice_threshold - plane, 0, white_level)
        result[f"gray_{bit:02d}"] = mirrored.astype(np.uint8) if plane.dtype == np.uint8 else mirrored.astype(np.uint16)
    return result


def _check_one_size(images: Mapping[str, Image], sources: Mapping[str, str], folder: Path) -> None:
    first = next(iter(images))
    for name, image in images.items():
        if image.shape != images[first].shape or image.dtype != images[first].dtype:
            raise ManifestError(
                f"{folder / sources[name]}: is {_shape(image)} but {sources[first]} is {_shape(images[first])}; "
                "all images of a view have one size and depth"
            )


def _shape(image: Image) -> str:
    return f"{image.shape[1]}x{image.shape[0]} {image.dtype}"


def _scale(images: Mapping[Side, Mapping[str, Image]], manifest: Manifest, path: Path) -> tuple[int, int]:
    """(bit depth, white level) of the set."""
    every = [image for by_name in images.values() for image in by_name.values()]
    containers = {image.dtype.itemsize * 8 for image in every}
    if len(containers) > 1:
        raise ManifestError(f"{path}: the views mix 8-bit and 16-bit images")
    container = containers.pop()
    stated = manifest.images
    if container == 16 and stated.bit_depth is None:
        raise ManifestError(f"{path}: images.bit_depth is required for 16-bit files: how many bits do they fill?")
    bit_depth = stated.bit_depth or 8
    if bit_depth > container:
        raise ManifestError(f"{path}: images.bit_depth is {bit_depth} but the files have {container} bits")
    white_level = stated.white_level or 2**bit_depth - 1
    brightest = max(int(image.max()) for image in every)
    if stated.white_level is None and brightest > white_level:
        raise ManifestError(
            f"{path}: images.bit_depth is {bit_depth} but a pixel reads {brightest}; mend it or give images.white_level"
        )
    return bit_depth, white_level


def _rig(calibration: CalibrationFiles | None, folder: Path, path: Path, size: tuple[int, int]) -> Rig | None:
    if calibration is None:
        return None
    try:
        files = [resolve_file(folder, name, "calibration") for name in calibration.files]
    except ManifestError as error:
        raise ManifestError(f"{path}: {error}") from error
    if any(file.suffix.lower() == ".json" for file in files):
        if len(files) > 1 or calibration.fields or calibration.units != "mm":
            raise ManifestError(f"{path}: calibration: a calibration.json stands alone, in mm and without fields")
        rig = Rig.from_file(files[0])
    else:
        cameras = read_opencv_cameras(
            files,
            names=calibration.fields,
            size=calibration.size or size,
            millimetres_per_unit=MILLIMETRES[calibration.units],
        )
        rig = Rig(*cameras, quality={"source": ", ".join(calibration.files)})
    if rig.left.size != size:
        raise CalibrationError(
            f"{files[0]}: is for images of {rig.left.width}x{rig.left.height} "
            f"but the set's are {size[0]}x{size[1]}; take the calibration that belongs to the set"
        )
    return rig


def _provenance(manifest: Manifest, path: Path, sources: Mapping[Side, Mapping[str, str]]) -> dict[str, Any]:
    return {
        "manifest": path.name,
        "manifest_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "channel": manifest.images.channel,
        "files": {side: dict(files) for side, files in sources.items()},
    }
