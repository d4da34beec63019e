"""Draws the pictures of docs/gallery.md into a folder: ``python -m benchmarks.gallery docs/images``.

The simulated scene is always drawn, the recorded sets where DUOFRINGE_DATA has them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.real_captures import (
    CARRIERS,
    COMPOSITE_SCENES,
    COMPOSITE_SET,
    SingleFrame,
    error_figures,
    recorded_stereo,
    single_frame,
    stereo_figures,
)
from models.atomic import atomic_file
from service.demonstration import DEFAULT_SEED, RECORDED_SET, demonstrate, recorded_sets
from service.figure import Panel, compose
from service.overview import recorded_figure
from service.pictures import Picture, error_scale, grey_picture, phase_scale

QUALITY = 72
"""Of the JPEG files; keeps each below 450 KB."""
ERROR_LIMIT_RAD = 0.3


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.gallery", description=__doc__)
    arguments.add_argument("folder", type=Path, help="existing folder for the pictures")
    folder: Path = arguments.parse_args().folder
    if not folder.is_dir():
        sys.exit(f"folder '{folder}' does not exist; create it first")
    write_jpeg(folder / "overview.jpg", overview_picture())
    sets = recorded_sets()
    if sets is None:
        print("the recorded sets are not at hand; set DUOFRINGE_DATA to draw them as well", file=sys.stderr)
        return
    write_jpeg(folder / f"{RECORDED_SET}.jpg", stereo_picture(sets))
    for scene in COMPOSITE_SCENES:
        write_jpeg(folder / f"{COMPOSITE_SET}_{scene}.jpg", composite_picture(single_frame(sets, scene), scene))


def overview_picture() -> Picture:
    """The overview of ``duofringe demo``."""
    with tempfile.TemporaryDirectory() as folder:
        demonstrate(Path(folder), DEFAULT_SEED, lambda stage, share: None)
        return np.asarray(cv2.imread(str(Path(folder) / "overview.png")), np.uint8)


def stereo_picture(sets: Path) -> Picture:
    """The recorded stereo scan."""
    capture, result = recorded_stereo(sets)
    figures = stereo_figures(result)
    subtitle = (
        f"{RECORDED_SET}: two cameras, four phase steps, six Gray planes. "
        f"{figures['matched_percent']:.1f} % of the pixels with a projector column are matched, "
        f"local noise {figures['noise_mm']:.2f} mm"
    )
    return recorded_figure("A plaster head, recorded by another rig", subtitle, capture, result)


def composite_picture(frame: SingleFrame, scene: str) -> Picture:
    """One recorded composite frame: what the filter makes of it, and how far that is from the twelve steps."""
    image = frame.capture.images["left"]["composite"]
    texture = frame.texture
    figures = error_figures(frame)
    scale = replace(error_scale(ERROR_LIMIT_RAD), unit="rad")
    shown = np.where(frame.lit, frame.phase, np.nan)
    given = [
        Panel("The frame", grey_picture(image, float(np.percentile(image, 99.7))), "both fringes in one exposure"),
        Panel("Texture", grey_picture(texture, float(np.percentile(texture, 99.7))), "the frame without its fringes"),
    ]
    rows = []
    for index, name in enumerate(CARRIERS):
        median, rms = figures[f"{name}_median_rad"], figures[f"{name}_rms_rad"]
        rows.append(
            [
                given[index],
                Panel(f"{name.capitalize()} phase", phase_scale().paint(shown[index]), "", phase_scale()),
                Panel(
                    f"Error of the {name} phase",
                    scale.paint(frame.error[index]),
                    f"against twelve steps: median {median:.3f}, rms {rms:.3f} rad",
                    scale,
                ),
            ]
        )
    title = f"One recorded frame: {scene}"
    return compose(title, f"{COMPOSITE_SET}: one camera, no calibration, bands read from the spectrum", rows)


def write_jpeg(path: Path, picture: Picture) -> None:
    """Write a picture as JPEG, without thinning out its colours, which would blur the fringes."""
    choices = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    choices += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    encoded, data = cv2.imencode(".jpg", picture, choices)
    if not encoded:
        raise OSError(f"{path}: could not be encoded")
    with atomic_file(path) as partial:
        partial.write_bytes(data.tobytes())
    print(f"{path}: {len(data) // 1024} KB")


if __name__ == "__main__":
    main()
