"""The figures of a reconstruction: what was seen, what was decoded, what came out, and how wrong it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.capture import Capture, Image
from models.geometry.rig import Side
from models.points import PointMap, Reason
from models.reconstruct import Reconstruction
from service.figure import Panel, compose
from service.pictures import (
    ColourScale,
    FloatMap,
    Picture,
    depth_scale,
    error_scale,
    grey_picture,
    phase_scale,
    shaded_picture,
    tight_range,
    write_picture,
)

ERROR_LIMIT_MM = 1.0
_CARRIERS = ("high", "low")


def phase_map(reconstruction: Reconstruction, side: Side, carrier: int) -> FloatMap:
    """Wrapped phase (H, W), radians, NaN where it must not be used."""
    phase = reconstruction.phases[side]
    wrapped: FloatMap = phase.wrapped[carrier].numpy()
    return np.where(phase.mask.numpy() == Reason.VALID, wrapped, np.nan)


def write_maps(reconstruction: Reconstruction, folder: Path, stem: str) -> list[Path]:
    """Depth, shaded surface and the phases of both views as ``<stem>_*.png``; returns what was written."""
    points = reconstruction.points
    pictures: dict[str, Picture] = {
        "depth": depth_scale(tight_range(points.depth)).paint(points.depth),
        "surface": shaded_picture(points.normals),
    }
    for side, phase in reconstruction.phases.items():
        for carrier in range(len(phase.periods)):
            name = f"phase_{_CARRIERS[carrier]}_{side}"
            pictures[name] = phase_scale().paint(phase_map(reconstruction, side, carrier))
    paths = [folder / f"{stem}_{name}.png" for name in pictures]
    for path, picture in zip(paths, pictures.values(), strict=True):
        write_picture(path, picture)
    return paths


def compare_figure(
    title: str, subtitle: str, capture: Capture, single: Reconstruction, stepped: Reconstruction
) -> Picture:
    """A single-shot reconstruction beside its N-step reference; ``capture`` has the composite and its truth."""
    assert capture.truth is not None
    scale = depth_scale(tight_range(stepped.points.depth))
    error = np.where(capture.truth.foreground, single.points.depth - capture.truth.depth, np.nan)
    periods = single.phases["left"].periods
    top = [
        _exposure_panel(capture, "left", "composite", "Left camera", "one exposure, both fringes in it"),
        *(
            Panel(
                f"{_CARRIERS[c].capitalize()} phase",
                phase_scale().paint(phase_map(single, "left", c)),
                f"windowed Fourier filter, period {periods[c]:g} columns",
                phase_scale(),
            )
            for c in range(2)
        ),
        _exposure_panel(capture, "right", "composite", "Right camera", "the same instant"),
    ]
    exposures = sum(p.is_fringe or p.is_gray or p.is_uniform for p in capture.plan.patterns)
    bottom = [
        _depth_panel(single, scale, "Depth from one exposure", f"wft, {single.matching} matching"),
        _depth_panel(stepped, scale, f"Depth from {exposures} exposures", "phase shift and Gray code"),
        Panel(
            "Error of the one exposure", error_scale(ERROR_LIMIT_MM).paint(error), _error_caption(error), error_scale(1)
        ),
        Panel("Surface from one exposure", shaded_picture(single.points.normals), "normals, lit from above"),
    ]
    return compose(title, subtitle, [top, bottom])


def recorded_figure(title: str, subtitle: str, capture: Capture, reconstruction: Reconstruction) -> Picture:
    """A recorded capture: its white image, phase, depth and surface."""
    panels = [
        _exposure_panel(capture, "left", "white", "Left camera", "white"),
        Panel(
            "Wrapped phase",
            phase_scale().paint(phase_map(reconstruction, "left", 0)),
            f"{len(capture.plan.of_kind('high'))} steps, light grey where there is no signal",
            phase_scale(),
        ),
        _depth_panel(
            reconstruction,
            depth_scale(tight_range(reconstruction.points.depth)),
            "Depth",
            f"{reconstruction.options.method}, {reconstruction.matching} matching",
        ),
        Panel("Surface", shaded_picture(reconstruction.points.normals), "normals, lit from above"),
    ]
    return compose(title, subtitle, [panels])


def _exposure_panel(capture: Capture, side: Side, pattern: str, title: str, caption: str) -> Panel:
    image: Image = capture.images[side][pattern]
    # A share of the full scale is dark on paper; the caption tells nothing of absolute brightness.
    return Panel(title, grey_picture(image, max(1.0, float(np.percentile(image, 99.7)))), caption)


def _depth_panel(reconstruction: Reconstruction, scale: ColourScale, title: str, how: str) -> Panel:
    points: PointMap = reconstruction.points
    return Panel(title, scale.paint(points.depth), f"{how}, {len(points):,} points", scale)


def _error_caption(error: FloatMap) -> str:
    absolute = np.abs(error[np.isfinite(error)])
    if absolute.size == 0:
        return "no pixel can be compared"
    return f"median {np.median(absolute):.2f} mm, {np.mean(absolute <= 1):.0%} within 1 mm; blue is too near"
