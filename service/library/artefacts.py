"""What a reconstruction can be asked for beside its record: clouds and pictures, made when first asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, get_args

from models.export import write_points
from models.export.npz import read_npz
from models.geometry.rig import SIDES, Side
from service.library.phases import CARRIERS, Carrier, read_phase
from service.pictures import depth_scale, phase_scale, shaded_picture, tight_range, write_picture

Artefact = Literal[
    "points.npz",
    "points.ply",
    "points.pcd",
    "points.xyz",
    "points.glb",
    "depth.tiff",
    "depth.png",
    "surface.png",
    "phase/high/left.png",
    "phase/high/right.png",
    "phase/low/left.png",
    "phase/low/right.png",
]
ARTEFACTS: tuple[Artefact, ...] = get_args(Artefact)
POINTS_FILE, PHASES_FILE = "points.npz", "phases.npz"
PHASE_ARTEFACTS: Mapping[str, tuple[Carrier, Side]] = {
    f"phase/{carrier}/{side}.png": (carrier, side) for carrier in CARRIERS for side in SIDES
}


def file_name(artefact: Artefact) -> str:
    """Name of an artefact's file in the folder of its reconstruction."""
    return artefact.replace("/", "_")


def make_artefact(artefact: Artefact, folder: Path, output: Path) -> None:
    """Write an artefact of the reconstruction in ``folder`` to ``output``, which has its suffix.

    Clouds are those that ``write_points`` makes, to the byte. Raises DuofringeError when the folder is damaged.
    """
    if artefact in PHASE_ARTEFACTS:
        carrier, side = PHASE_ARTEFACTS[artefact]
        write_picture(output, phase_scale().paint(read_phase(folder / PHASES_FILE, carrier, side)))
    else:
        _OF_POINTS.get(artefact, _write_points)(folder, output)


def _write_points(folder: Path, output: Path) -> None:
    write_points(read_npz(folder / POINTS_FILE), output)


def _write_depth_picture(folder: Path, output: Path) -> None:
    depth = read_npz(folder / POINTS_FILE).depth
    write_picture(output, depth_scale(tight_range(depth)).paint(depth))


def _write_surface_picture(folder: Path, output: Path) -> None:
    write_picture(output, shaded_picture(read_npz(folder / POINTS_FILE).normals))


_OF_POINTS: Mapping[str, Callable[[Path, Path], None]] = {
    "depth.png": _write_depth_picture,
    "surface.png": _write_surface_picture,
}
