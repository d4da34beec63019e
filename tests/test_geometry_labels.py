"""Projector columns that the rig's own agreement tells, against the columns of the simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_captures import objects_before_wall, only, plate_before_wall

from models.errors import CalibrationError
from models.geometry_labels import GeometryLabels
from models.reconstruct import ReconstructionOptions, reconstruct
from models.refiner.training.views import truth_columns


def test_both_views_learn_their_columns() -> None:
    capture = only(plate_before_wall(), {"composite"})
    assert capture.rig is not None
    told, truth = GeometryLabels("wft")(replace(capture, truth=None), capture.rig), truth_columns(capture, capture.rig)
    for side in capture.sides:
        labelled, lit = np.isfinite(told[side]), np.isfinite(truth[side])
        assert labelled[lit].mean() > 0.4  # the wall is partly seen by one view only
        error = np.abs(told[side] - truth[side])[labelled & lit]
        assert np.median(error) < 0.12
        assert np.mean(error > 1) < 0.02
        assert lit[labelled].mean() > 0.98


def test_a_projector_is_needed() -> None:
    capture = only(objects_before_wall(), {"composite"})
    assert capture.rig is not None
    with pytest.raises(CalibrationError, match="A4"):
        GeometryLabels()(capture, replace(capture.rig, projector=None, raster=None))


@pytest.mark.parametrize("kinds", [{"white", "black", "high", "low"}, {"white", "black", "high", "low", "gray"}])
def test_a_rig_seen_from_the_right_gives_the_same_surface(kinds: set[str]) -> None:
    """There the projector's columns fall along the baseline."""
    capture = only(objects_before_wall(), kinds)  # type: ignore[arg-type]
    assert capture.rig is not None
    swapped = replace(capture, images={"left": capture.images["right"], "right": capture.images["left"]}, truth=None)
    usual = reconstruct(capture, ReconstructionOptions("nstep")).points
    other = reconstruct(swapped, ReconstructionOptions("nstep"), rig=capture.rig.from_the_right).points
    assert len(other) > 0.9 * len(usual)
    right = capture.rig.right
    back = (other.points[other.valid] - right.translation) @ right.rotation
    x, y = np.moveaxis(capture.rig.left.project(back.astype(np.float64)), -1, 0)
    inside = (x > 0) & (y > 0) & (x < right.width - 1) & (y < right.height - 1)
    near = usual.depth[np.rint(y[inside]).astype(int), np.rint(x[inside]).astype(int)]
    assert np.nanmedian(np.abs(near - back[inside, 2])) < 0.2
