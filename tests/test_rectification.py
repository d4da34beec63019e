"""Rectification: rows agree, nothing that both cameras see is cut off, and points come back where they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.errors import CalibrationError
from models.geometry.device import Device
from models.geometry.rectification import rectify
from models.geometry.rig import Rig


def seen_by_both(rig: Rig, count: int, seed: int = 0, border: float = 1.0) -> np.ndarray:
    """Random points (n, 3) of the working range that stand on both sensors, ``border`` px inside their edge pixels."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(border, np.array(rig.left.size) - 1 - border, (count, 2))
    points = rig.left.back_project(pixels, rng.uniform(400, 670, count))
    right = rig.right.project(points)
    return points[((right >= border) & (right <= np.array(rig.right.size) - 1 - border)).all(axis=1)]


def rigs(rig: Rig) -> dict[str, Rig]:
    """The reference rig, one with strongly toed-in unequal cameras, one with parallel ones of other focal lengths."""
    angle = np.deg2rad(25)
    turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    long = np.array([[1250.0, 0, 330.0], [0, 1250, 250], [0, 0, 1]])
    toed = Device((660, 500), long, [0.05, -0.1, 0, 0, 0], turn.T, turn.T @ [-210.0, 15.0, -30.0], name="right")
    parallel = Device((640, 480), long, np.zeros(4), np.eye(3), [-120.0, 0, 0], name="right")
    return {"reference": rig, "toed-in": Rig(rig.left, toed), "parallel": Rig(rig.left, parallel)}


@pytest.mark.parametrize("name", ["reference", "toed-in", "parallel"])
class TestEveryRig:
    def test_rows_agree_and_the_canvases_hold_every_common_point(self, rig: Rig, name: str) -> None:
        chosen = rigs(rig)[name]
        points = seen_by_both(chosen, 20_000)
        assert len(points) > 3000
        rectification = rectify(chosen)
        canvas = {side: rectification.canvas_coordinates(side, points) for side in ("left", "right")}
        assert np.abs(canvas["left"][:, 1] - canvas["right"][:, 1]).max() < 1e-6
        for side, pixels in canvas.items():
            width, height = rectification.sizes[side]  # type: ignore[index]
            assert (pixels >= 0).all()
            assert (pixels <= np.array([width, height]) - 1).all()

    def test_maps_lead_from_the_canvas_to_the_sensor(self, rig: Rig, name: str) -> None:
        chosen = rigs(rig)[name]
        rectification = rectify(chosen)
        points = seen_by_both(chosen, 500, seed=3)
        for side, camera in chosen.cameras.items():
            shown = camera.project(points)
            x, y = rectification.canvas_coordinates(side, points).T
            height, width = rectification.maps[side].shape[:2]
            i, k = np.clip(np.rint(y).astype(int), 0, height - 1), np.clip(np.rint(x).astype(int), 0, width - 1)
            assert np.abs(rectification.maps[side][i, k] - shown).max() < 1.5

    def test_left_sensor_pixels_know_their_place_on_the_canvas(self, rig: Rig, name: str) -> None:
        rectification = rectify(rigs(rig)[name])
        pixels = np.array([[0, 0], [639, 0], [320, 240], [17, 450]])
        points = rig.left.back_project(pixels.astype(float), np.full(4, 512.0))
        expected = rectification.canvas_coordinates("left", points)
        assert np.abs(rectification.canvas_of_left[pixels[:, 1], pixels[:, 0]] - expected).max() < 1e-3


@given(
    x=st.floats(-150, 250),
    y=st.floats(-150, 150),
    z=st.floats(200, 3000),
)
def test_triangulation_returns_the_point(rig: Rig, x: float, y: float, z: float) -> None:
    rectification = rectify(rig)
    point = np.array([x, y, z])
    left, right = (rectification.canvas_coordinates(side, point) for side in ("left", "right"))
    back = rectification.triangulate(left[0], right[0], left[1])
    assert np.abs(back - point).max() < 1e-7 * z


def test_rays_that_do_not_meet_give_no_point(rig: Rig) -> None:
    rectification = rectify(rig)
    parallel = rectification.cx["right"] - rectification.cx["left"]
    points = rectification.triangulate([100.0, 100.0, np.nan], [100 + parallel, 150 + parallel, 90.0], [50.0] * 3)
    assert np.isnan(points).all()


def test_one_rig_is_rectified_once(rig: Rig) -> None:
    assert rectify(rig) is rectify(rig)


@pytest.mark.parametrize(
    ("turn", "translation", "fault"),
    [
        (np.eye(3), [0.0, 0.0, -100.0], "along the baseline"),  # one camera before the other
        (np.diag([-1.0, 1.0, -1.0]), [-120.0, 0.0, 0.0], "away from the other"),
        (np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), [-120.0, 0.0, 0.0], "camera: part of the sensor|no rows"),
    ],
    ids=["in line", "back to back", "at right angles"],
)
def test_impossible_rigs_are_refused(rig: Rig, turn: np.ndarray, translation: list[float], fault: str) -> None:
    right = replace(rig.right, rotation=turn, translation=np.array(translation))
    with pytest.raises(CalibrationError, match=fault):
        rectify(Rig(rig.left, right))


def test_cameras_that_share_no_rows_are_refused(rig: Rig) -> None:
    angle = np.deg2rad(35)
    up = np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    right = replace(rig.right, rotation=up, translation=np.array([-120.0, 0, 0]))
    with pytest.raises(CalibrationError, match="share no rows"):
        rectify(Rig(rig.left, right))
