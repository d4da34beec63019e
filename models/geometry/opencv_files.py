"""Rig calibrations in OpenCV's FileStorage (YAML, XML): the files that stereo calibration programs leave behind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from models.errors import CalibrationError
from models.geometry.device import Device

_NAMES: dict[str, tuple[str, ...]] = {
    "left_matrix": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "cameraMatrixL"),
    "left_distortion": ("D1", "distCoeffs1", "dist_coeffs_1", "distCoeffsL"),
    "right_matrix": ("M2", "K2", "cameraMatrix2", "camera_matrix_2", "cameraMatrixR"),
    "right_distortion": ("D2", "distCoeffs2", "dist_coeffs_2", "distCoeffsR"),
    "rotation": ("R",),
    "translation": ("T", "t"),
    "size": ("imageSize", "image_size", "size"),
}
FIELDS = tuple(_NAMES)
"""Roles that a manifest may rename."""


def read_opencv_cameras(
    paths: Sequence[Path],
    *,
    names: Mapping[str, str] | None = None,
    size: tuple[int, int] | None = None,
    millimetres_per_unit: float = 1.0,
) -> tuple[Device, Device]:
    """Left and right camera of a stereo calibration spread over one or more FileStorage files.

    names: field name for a role of ``FIELDS`` where it is not OpenCV's usual one. size: (width, height) for files
    that do not tell it. millimetres_per_unit: scale of the translation. Raises CalibrationError naming what lacks.
    """
    found: dict[str, np.ndarray] = {}
    for path in paths:
        found |= {k: v for k, v in _read_fields(path, names or {}).items() if k not in found}
    missing = [role for role in FIELDS if role not in found and role != "size"]
    if missing:
        wanted = ", ".join(f"{role} ({'/'.join(_candidates(role, names or {}))})" for role in missing)
        raise CalibrationError(f"{', '.join(str(p) for p in paths)}: lacks {wanted}")
    if "size" in found:
        stored = found["size"].ravel()
        if stored.size != 2 or not all(float(n).is_integer() for n in stored):
            raise CalibrationError(f"{paths[0]}: the image size must be two whole numbers, got {stored.tolist()}")
        size = (int(stored[0]), int(stored[1]))
    if size is None:
        raise CalibrationError(
            f"{paths[0]}: lacks the image size (imageSize); give it in the manifest or store it there"
        )
    left = Device(size, found["left_matrix"], found["left_distortion"], name="left")
    rotation = found["rotation"]
    if rotation.size == 3:
        rotation = cv2.Rodrigues(rotation.ravel())[0]
    right = Device(
        size,
        found["right_matrix"],
        found["right_distortion"],
        rotation,
        found["translation"].ravel() * millimetres_per_unit,
        name="right",
    )
    return left, right


def _candidates(role: str, names: Mapping[str, str]) -> tuple[str, ...]:
    return (names[role],) if role in names else _NAMES[role]


def _read_fields(path: Path, names: Mapping[str, str]) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise CalibrationError(f"calibration file '{path}' does not exist")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError) as error:  # the constructor wraps the parser's error in a SystemError
        raise CalibrationError(f"{path}: not an OpenCV FileStorage file") from error
    if not storage.isOpened():
        raise CalibrationError(f"{path}: not an OpenCV FileStorage file")
    try:
        fields = {}
        for role in FIELDS:
            for name in _candidates(role, names):
                try:
                    value = _read_node(storage.getNode(name))
                except cv2.error as error:
                    raise CalibrationError(f"{path}: field '{name}' is not a matrix of numbers") from error
                if value is not None:
                    fields[role] = value
                    break
        return fields
    finally:
        storage.release()


def _read_node(node: cv2.FileNode) -> np.ndarray | None:
    if node.isSeq():
        items = [node.at(i) for i in range(node.size())]
        if not all(item.isInt() or item.isReal() for item in items):
            raise cv2.error("a sequence holds something else than numbers")
        return np.array([item.real() for item in items])
    if node.isMap():
        matrix = node.mat()
        return None if matrix is None else np.asarray(matrix, np.float64)
    return None
