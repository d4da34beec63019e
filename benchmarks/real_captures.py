"""Results on the two recorded sets of DUOFRINGE_DATA, imported through their manifests.

``stereo_small_mit`` has no truth: matched share, depths and local noise are told. ``composite_fringe`` has each carrier
in twelve steps, against which the phases of a single composite frame are compared.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.report import parser, show
from models.capture import Capture
from models.foreign import import_capture
from models.phase.nstep import NStep
from models.phase.wft import WindowedFourierTransform
from models.points import PointMap, Reason
from models.reconstruct import Reconstruction, ReconstructionOptions, reconstruct
from service.demonstration import RECORDED_MANIFEST, RECORDED_SET, REPOSITORY, recorded_sets

COMPOSITE_SET = "composite_fringe"
COMPOSITE_SCENES = ("object", "plane")
CARRIERS = ("high", "low")
LIT = 0.02
"""Modulation of the twelve steps, share of full scale, from which a pixel is compared."""
OBJECT = 0.06
"""Modulation from which a pixel of the stereo scan is the plaster head and not the dim wall behind it."""


@dataclass(frozen=True, eq=False)
class SingleFrame:
    """Phases of one composite frame beside those of the twelve steps.

    phase: float32 (2, H, W), wrapped, rad. texture: float32 (H, W), the frame without fringes, share of full scale.
    error: float32 (2, H, W), wrapped difference to the twelve steps, rad, NaN where not compared.
    lit: bool (H, W), where the twelve steps have signal.
    """

    capture: Capture
    phase: npt.NDArray[np.float32]
    texture: npt.NDArray[np.float32]
    error: npt.NDArray[np.float32]
    lit: npt.NDArray[np.bool_]


def recorded_stereo(sets: Path) -> tuple[Capture, Reconstruction]:
    """The recorded stereo scan and its reconstruction."""
    capture = import_capture(sets / RECORDED_SET, RECORDED_MANIFEST)
    return capture, reconstruct(capture, ReconstructionOptions(method="nstep"))


def stereo_figures(result: Reconstruction) -> dict[str, float]:
    """On the object: matched share (%) of pixels with a projector column, depths (1st, 99th percentile), noise (mm)."""
    left = result.phases["left"]
    assert left.column is not None
    told = left.mask.numpy() == Reason.VALID
    told &= np.isfinite(left.column.numpy())
    lit = told & (left.modulation[0].numpy() >= OBJECT)
    depth = result.points.depth[result.points.valid & lit]
    return {
        "points": float(len(result.points)),
        "matched_percent": 100 * float(result.points.valid[lit].mean()),
        "z_low_mm": float(np.percentile(depth, 1)),
        "z_high_mm": float(np.percentile(depth, 99)),
        "noise_mm": local_noise(result.points, lit),
    }


def local_noise(points: PointMap, where: npt.NDArray[np.bool_]) -> float:
    """Median |Z - median of the 5x5 pixels about it|, mm, where all of these are valid."""
    whole = cv2.erode(points.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    depth = np.nan_to_num(points.depth).astype(np.float32)
    return float(np.median(np.abs(depth - cv2.medianBlur(depth, 5))[whole & where]))


def single_frame(sets: Path, scene: str) -> SingleFrame:
    """Phases of the single composite frame of a scene of ``composite_fringe``."""
    manifest = REPOSITORY / "examples" / "manifests" / f"{COMPOSITE_SET}_{scene}.toml"
    capture = import_capture(sets / COMPOSITE_SET, manifest)
    found = WindowedFourierTransform().extract(capture)["left"]
    expected = NStep().extract(capture)["left"]
    lit = (expected.mask.numpy() == Reason.VALID) & (expected.modulation.numpy() >= LIT).all(axis=0)
    phase, reference = found.wrapped.numpy(), expected.wrapped.numpy()
    error = np.angle(np.exp(1j * (phase - reference))).astype(np.float32)
    error[:, ~lit | (found.mask.numpy() != Reason.VALID)] = np.nan
    return SingleFrame(capture, phase, found.texture.numpy(), error, lit)


def error_figures(frame: SingleFrame) -> dict[str, float]:
    """Median |error| and rms per carrier, rad, and the share of the lit pixels that were compared, %."""
    compared = np.isfinite(frame.error[0])
    figures = {"compared_percent": 100 * float(compared[frame.lit].mean())}
    for name, error in zip(CARRIERS, frame.error[:, compared], strict=True):
        figures[f"{name}_median_rad"] = float(np.median(np.abs(error)))
        figures[f"{name}_rms_rad"] = float(np.sqrt(np.mean(error.astype(np.float64) ** 2)))
    return figures


def main() -> None:
    options = parser("real_captures", __doc__ or "").parse_args()
    sets = recorded_sets()
    if sets is None:
        sys.exit("the recorded sets are not at hand; set DUOFRINGE_DATA to the folder that holds them")
    stereo = stereo_figures(recorded_stereo(sets)[1])
    rows = [["figure", "value"]]
    rows += [
        ["stereo_small_mit: points", f"{stereo['points']:,.0f}"],
        ["matched share of the object's pixels", f"{stereo['matched_percent']:.1f} %"],
        ["Z, 1st to 99th percentile", f"{stereo['z_low_mm']:.0f}..{stereo['z_high_mm']:.0f} mm"],
        ["noise, median |Z - 5x5 median|", f"{stereo['noise_mm']:.2f} mm"],
    ]
    data: dict[str, Any] = {"benchmark": "real_captures", RECORDED_SET: stereo}
    for scene in COMPOSITE_SCENES:
        figures = error_figures(single_frame(sets, scene))
        data[f"{COMPOSITE_SET}_{scene}"] = figures
        rows.append(
            [f"{COMPOSITE_SET}, {scene}: compared pixels of the lit ones", f"{figures['compared_percent']:.1f} %"]
        )
        for name in CARRIERS:
            median, rms = figures[f"{name}_median_rad"], figures[f"{name}_rms_rad"]
            rows.append([f"{name} phase error, median and rms", f"{median:.3f}, {rms:.3f} rad"])
    show("Recorded sets", rows, data, as_json=options.json)


if __name__ == "__main__":
    main()
