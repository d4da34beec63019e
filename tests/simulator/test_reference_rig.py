"""The reference geometry of the simulated rig."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.simulator.geometry import reference_rig
from models.geometry.rig import Rig

MEETING_POINT = np.array([0.0, 0.0, 500.0])


def test_axes_meet_half_a_metre_away():
    rig = reference_rig()
    for device in (rig.left, rig.right, rig.projector):
        assert np.allclose(device.project(MEETING_POINT), device.matrix[:2, 2], atol=1e-9)


def test_devices_stand_where_the_table_says():
    rig = reference_rig()
    assert np.allclose(rig.left.centre, 0)
    assert np.allclose(rig.right.centre, [120, 0, 0])
    assert np.allclose(rig.projector.centre, [60, -60, 0])  # y points down


def test_raster_covers_420_by_262_mm_at_its_distance():
    projector = reference_rig().projector
    assert projector.size == (912, 1140)
    assert 500 / projector.fx * 912 == pytest.approx(420, abs=1)
    assert 500 / projector.fy * 1140 == pytest.approx(262, abs=1)


def test_rows_of_a_diamond_raster_are_half_as_high():
    diamond, square = reference_rig("diamond"), reference_rig("square")
    assert diamond.projector.fy == 2 * diamond.projector.fx
    assert square.projector.fy == square.projector.fx
    assert (diamond.raster.kind, square.raster.kind) == ("diamond", "square")


def test_all_lenses_distort():
    rig = reference_rig()
    assert rig.left.distortion[0] == pytest.approx(-0.1, abs=0.01)
    assert rig.right.distortion[0] == pytest.approx(-0.1, abs=0.01)
    assert rig.projector.distortion[0] == pytest.approx(-0.03, abs=0.001)
    assert not np.array_equal(rig.left.distortion, rig.right.distortion)


@pytest.mark.parametrize("shift", [0.5, 1.0])
def test_lens_shift_moves_the_axis_but_not_the_image(shift):
    shifted = reference_rig(lens_shift=shift).projector
    raster_centre = np.array([(912 - 1) / 2, (1140 - 1) / 2])
    assert np.abs(shifted.project(MEETING_POINT) - raster_centre).max() < 1.5  # the lens distorts off its axis
    assert shifted.matrix[1, 2] == pytest.approx(raster_centre[1] + shift * 570)
    axis = shifted.rotation[2]
    aim = MEETING_POINT - shifted.centre
    # throws above its axis: the axis points lower (y larger) than the image's centre
    assert axis[1] / axis[2] > aim[1] / aim[2]


def test_calibration_file_keeps_the_rig(tmp_path):
    rig = reference_rig()
    rig.to_file(tmp_path / "calibration.json")
    again = Rig.from_file(tmp_path / "calibration.json")
    assert again.working_depths == (400.0, 670.0)
    points = np.random.default_rng(0).uniform([-100, -80, 400], [100, 80, 670], (50, 3))
    assert np.array_equal(again.projector.project(points), rig.projector.project(points))
