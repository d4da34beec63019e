"""Files of a point map, chosen by suffix, each complete under its name or absent."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from models.atomic import atomic_file
from models.errors import ExportError
from models.export.glb import write_glb
from models.export.npz import write_npz
from models.export.pcd import write_pcd
from models.export.ply import write_ply
from models.export.tiff import write_tiff
from models.export.xyz import write_xyz
from models.points import PointMap

_WRITERS: dict[str, Callable[[PointMap, Path], None]] = {
    ".npz": write_npz,
    ".ply": write_ply,
    ".pcd": write_pcd,
    ".xyz": write_xyz,
    ".tiff": write_tiff,
    ".tif": write_tiff,
    ".glb": write_glb,
}
SUFFIXES = tuple(_WRITERS)


def check_output(path: Path) -> None:
    """Raise ExportError unless ``path`` has a known suffix and can be written; for use before the long work."""
    if path.suffix.lower() not in _WRITERS:
        raise ExportError(f"output '{path}': suffix '{path.suffix}' is unknown; use one of {', '.join(SUFFIXES)}")
    if not path.parent.is_dir():
        raise ExportError(f"output folder '{path.parent}' does not exist; create it first")
    if path.is_dir():
        raise ExportError(f"output '{path}' is a folder; name a file")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise ExportError(f"output folder '{path.parent}' may not be written to; change its permissions")


def write_points(points: PointMap, path: Path) -> None:
    """Write a point map in the format of the suffix; an existing file is replaced once the new one is whole.

    Raises ExportError as ``check_output`` does, when there is no valid point, and when writing fails.
    """
    check_output(path)
    if len(points) == 0:
        raise ExportError(f"output '{path}' was not written: no pixel has a point")
    try:
        with atomic_file(path) as partial:
            _WRITERS[path.suffix.lower()](points, partial)
    except OSError as error:
        raise ExportError(f"output '{path}' could not be written: {error.strerror or error}") from error
