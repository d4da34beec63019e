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
    share_scale,
    tight_range,
    write_picture,
)

ERROR_LIMIT_MM = 1.0
_RECORDED_SMOOTHING = 5.0
"""px; at the full resolution of a recorded scan the normals of single pixels are mostly noise."""
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
    title: str,
    subtitle: str,
    capture: Capture,
    refined: Reconstruction,
    filtered: Reconstruction,
    stepped: Reconstruction,
) -> Picture:
    """One exposure refined and only filtered beside its N-step reference; ``capture`` has the composite and its truth.

    Rows: what was seen and decoded; depth by each method; its error, and how sure the refiner was.
    """
    assert capture.truth is not None
    truth = np.where(capture.truth.foreground, capture.truth.depth, np.nan)
    scale = depth_scale(tight_range(stepped.points.depth))
    periods = refined.phases["left"].periods
    exposures = sum(p.is_fringe or p.is_gray or p.is_uniform for p in capture.plan.patterns)
    seen = [
        _exposure_panel(capture, "left", "composite", "Left camera", "one exposure, both fringes in it"),
        _exposure_panel(capture, "right", "composite", "Right camera", "the same instant"),
        *(
            Panel(
                f"{_CARRIERS[c].capitalize()} phase",
                phase_scale().paint(phase_map(refined, "left", c)),
                f"refined, {periods[c]:g} columns a fringe",
                phase_scale(),
            )
            for c in range(2)
        ),
    ]
    depths = [
        _depth_panel(refined, scale, "One exposure, refined", "windowed Fourier filter and network"),
        _depth_panel(filtered, scale, "One exposure", "windowed Fourier filter"),
        _depth_panel(stepped, scale, f"{exposures} exposures", "phase shift and Gray code"),
        Panel("Surface, refined", shaded_picture(refined.points.normals), "normals, lit from above"),
    ]
    errors = [
        _error_panel(refined.points.depth - truth, "Error, refined"),
        _error_panel(filtered.points.depth - truth, "Error, one exposure"),
        _error_panel(stepped.points.depth - truth, f"Error, {exposures} exposures"),
        _certainty_panel(refined),
    ]
    return compose(title, subtitle, [seen, depths, errors])


def _error_panel(error: FloatMap, title: str) -> Panel:
    scale = error_scale(ERROR_LIMIT_MM)
    return Panel(title, scale.paint(error), _error_caption(error), scale)


def _certainty_panel(reconstruction: Reconstruction) -> Panel:
    """How sure the method was of the left view's phases; the points' confidence for one that does not tell."""
    certainty = reconstruction.phases["left"].certainty
    scale = share_scale()
    if certainty is None:
        points = reconstruction.points
        return Panel(
            "Confidence", scale.paint(np.where(points.valid, points.confidence, np.nan)), "of each point", scale
        )
    return Panel("Certainty", scale.paint(certainty.cpu().numpy()), "the network's own, of its phases", scale)


def recorded_figure(title: str, subtitle: str, capture: Capture, reconstruction: Reconstruction) -> Picture:
    """A recorded capture: its white image, phase, depth and surface, cut to where the points are."""
    points = reconstruction.points
    part = _where_points_are(points)
    scale = depth_scale(tight_range(points.depth))
    panels = [
        _exposure_panel(capture, "left", "white", "Left camera", "white", part),
        Panel(
            "Wrapped phase",
            phase_scale().paint(phase_map(reconstruction, "left", 0)[part]),
            f"{len(capture.plan.of_kind('high'))} steps, light grey where there is no signal",
            phase_scale(),
        ),
        Panel(
            "Depth",
            scale.paint(points.depth[part]),
            _depth_caption(reconstruction, reconstruction.options.method),
            scale,
        ),
        Panel(
            "Surface",
            shaded_picture(points.normals[part], _RECORDED_SMOOTHING),
            f"normals averaged over {_RECORDED_SMOOTHING:g} px, lit from above",
        ),
    ]
    return compose(title, subtitle, [panels])


def _where_points_are(points: PointMap) -> tuple[slice, slice]:
    """Rows and columns that hold nearly all points, with a margin."""
    spans = []
    for axis, length in enumerate(points.shape):
        share = np.cumsum(points.valid.sum(axis=1 - axis, dtype=np.float64))
        first, last = np.searchsorted(share, share[-1] * np.array([0.01, 0.99]))
        margin = length // 32
        spans.append(slice(max(0, int(first) - margin), min(length, int(last) + margin)))
    return spans[0], spans[1]


def _exposure_panel(
    capture: Capture,
    side: Side,
    pattern: str,
    title: str,
    caption: str,
    part: tuple[slice, slice] = (slice(None), slice(None)),
) -> Panel:
    image: Image = capture.images[side][pattern][part]
    # A share of the full scale is dark on paper; the caption tells nothing of absolute brightness.
    return Panel(title, grey_picture(image, max(1.0, float(np.percentile(image, 99.7)))), caption)


def _depth_panel(reconstruction: Reconstruction, scale: ColourScale, title: str, how: str) -> Panel:
    return Panel(title, scale.paint(reconstruction.points.depth), _depth_caption(reconstruction, how), scale)


def _depth_caption(reconstruction: Reconstruction, how: str) -> str:
    return f"{how}, {reconstruction.matching} matching, {len(reconstruction.points):,} points"


def _error_caption(error: FloatMap) -> str:
    absolute = np.abs(error[np.isfinite(error)])
    if absolute.size == 0:
        return "no pixel can be compared"
    within = np.mean(absolute <= ERROR_LIMIT_MM)
    return f"median {np.median(absolute):.2f} mm, {within:.0%} within {ERROR_LIMIT_MM:g} mm; blue is too near"
