"""A picture of one evaluated sample: what was seen and is true, and below it a row of maps for each method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.capture import Capture
from models.metrics import Figures, Reference, SampleErrors, aggregate
from models.metrics.edges import BAND_PX
from models.reconstruct import Reconstruction
from service.figure import Panel, compose
from service.overview import phase_map
from service.pictures import (
    ColourScale,
    FloatMap,
    Picture,
    depth_scale,
    grey_picture,
    phase_scale,
    shaded_picture,
    tight_range,
    write_picture,
)

Mask = npt.NDArray[np.bool_]

ERROR_LIMIT_MM = 2.0
_MISSING_BGR = (214, 84, 250)
"""Pink: in none of the scales."""
_LINE_BGR = (96, 220, 40)
_THIN_WIDTH = 320
"""px of a picture for each px of a line's thickness."""


@dataclass(frozen=True, eq=False)
class DrawnRow:
    """Maps of a method's row, NaN where invalid: depth (H, W) mm, normals (H, W, 3), wrapped high phase (H, W) rad."""

    depth: FloatMap
    normals: FloatMap
    phase: FloatMap

    @classmethod
    def of(cls, reconstruction: Reconstruction) -> DrawnRow:
        points = reconstruction.points
        return cls(points.depth, points.normals, phase_map(reconstruction, "left", 0))


@dataclass(frozen=True, eq=False)
class Drawing:
    """What all rows of a picture share. band: pixels (H, W) near depth edges. period: of the high carrier, columns."""

    capture: Capture
    reference: Reference
    band: Mask
    period: float
    depth_range: tuple[float, float]

    @property
    def foreground(self) -> Mask:
        return self.reference.within(self.depth_range)


def write_evaluation_picture(
    path: Path, drawing: Drawing, rows: Mapping[str, DrawnRow], errors: Mapping[str, SampleErrors]
) -> None:
    """Draw a sample as a PNG. rows: methods that gave a result; errors: figures of these and of those that failed."""
    write_picture(path, evaluation_picture(path.stem, drawing, rows, errors))


def evaluation_picture(
    title: str, drawing: Drawing, rows: Mapping[str, DrawnRow], errors: Mapping[str, SampleErrors]
) -> Picture:
    """The picture, uint8 BGR. The colour scales are the same in all rows."""
    scale = depth_scale(tight_range(np.where(drawing.foreground, drawing.reference.depth, np.nan)))
    nothing: FloatMap = np.full(drawing.band.shape, np.nan)
    blank = DrawnRow(nothing, np.full((*nothing.shape, 3), np.nan), nothing)
    panels = [_truth_panels(drawing, scale)]
    panels += [_method_panels(row, rows.get(row, blank), aggregate([of]), drawing, scale) for row, of in errors.items()]
    subtitle = (
        "Light grey: nothing to show or to compare. Pink: foreground pixels without a result. Errors are clipped at "
        f"{ERROR_LIMIT_MM:g} mm. Green bounds what is farther than {BAND_PX} px from a depth edge."
    )
    return compose(title, subtitle, panels)


def _truth_panels(drawing: Drawing, scale: ColourScale) -> list[Panel]:
    reference, foreground = drawing.reference, drawing.foreground
    turns = np.where(foreground, reference.column, np.nan) / drawing.period
    phase = 2 * np.pi * (turns - np.round(turns))
    name, exposure = _exposure(drawing.capture)
    near = foreground & drawing.band
    share = near.sum() / max(1, foreground.sum())
    return [
        Panel(f"Left camera, {name}", exposure),
        Panel("High phase, truth", phase_scale().paint(phase), "where the foreground is", phase_scale()),
        Panel(
            "Depth, truth",
            scale.paint(np.where(foreground, reference.depth, np.nan)),
            f"{foreground.sum():,} foreground pixels",
            scale,
        ),
        Panel(
            "Near depth edges",
            _lined(exposure, foreground & ~drawing.band),
            f"within {BAND_PX} px: {share:.0%} of the foreground",
        ),
    ]


def _method_panels(row: str, drawn: DrawnRow, figures: Figures, drawing: Drawing, scale: ColourScale) -> list[Panel]:
    foreground = drawing.foreground
    error = np.abs(np.where(foreground, drawn.depth.astype(np.float64) - drawing.reference.depth, np.nan))

    def paint(values: FloatMap, colours: ColourScale) -> Picture:
        missing = foreground & np.isnan(values)
        return np.where(missing[..., None], np.array(_MISSING_BGR, np.uint8), colours.paint(values))

    return [
        Panel(f"{row}: surface", shaded_picture(drawn.normals), "normals, lit from above"),
        Panel(
            "High phase",
            paint(drawn.phase, phase_scale()),
            f"right order {_told(figures.order_accuracy, 1)} %, MAE {_told(figures.mae_phase, 2)} rad",
            phase_scale(),
        ),
        Panel("Depth", paint(drawn.depth, scale), f"valid {_told(figures.valid, 1)} %", scale),
        Panel(
            "Absolute depth error",
            _lined(paint(error, _error_scale()), foreground & ~drawing.band),
            f"MAE {_told(figures.mae_depth, 2)} mm, within 1 mm {_told(figures.within_1mm, 1)} %",
            _error_scale(),
        ),
    ]


def _error_scale() -> ColourScale:
    """Absolute errors in mm from dark to bright, clipped at the limit."""
    table = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_INFERNO)[:, 0]
    return ColourScale(np.asarray(table, np.uint8), 0.0, ERROR_LIMIT_MM, "mm")


def _exposure(capture: Capture) -> tuple[str, Picture]:
    """The composite exposure, or the first there is, as bright as a page can show it."""
    images = capture.images["left"]
    name = next((p.name for p in capture.plan.of_kind("composite")), next(iter(images)))
    return name, grey_picture(images[name], max(1.0, float(np.percentile(images[name], 99.7))))


def _lined(picture: Picture, region: Mask) -> Picture:
    """The picture with a line drawn just inside a region (H, W)."""
    bounds, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    drawn = picture.copy()
    cv2.drawContours(drawn, bounds, -1, _LINE_BGR, max(1, round(picture.shape[1] / _THIN_WIDTH)))
    return drawn


def _told(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if np.isfinite(value) else "-"
