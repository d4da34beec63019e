"""The exposure contract: what known surfaces read, and what a capture says about its own exposure."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_scenes import middle, slab, target, thing

from drivers.simulator.lamp import Levels
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from drivers.simulator.sensor import Sensor
from models.errors import CalibrationError
from models.geometry.rig import Rig
from models.patterns import make_plan

WHITE_BLACK = make_plan("full").restricted_to(["white", "black"])


@pytest.fixture(scope="module")
def simulated() -> SimulatedRig:
    return SimulatedRig()


def test_white_target_at_half_a_metre_reads_220(simulated):
    capture = simulated.render(target(albedo=0.8, depth=500.0), WHITE_BLACK)
    for side in ("left", "right"):
        assert middle(capture.images[side]["white"]).mean() == pytest.approx(220, abs=1.5)


def test_ambient_light_and_contrast_make_the_black_image(simulated):
    black = middle(simulated.render(target(), WHITE_BLACK).images["left"]["black"]).mean()
    assert black == pytest.approx(4 + 216 / 600, abs=0.1)
    dark = SimulatedRig(levels=Levels(off=1.0))  # only the sensor's own black level is left
    black = middle(dark.render(target(), WHITE_BLACK).images["left"]["black"]).mean()
    assert black == pytest.approx(1 + 219 / 600, abs=0.1)


def test_twelve_bits_read_the_same_share_of_full_scale():
    capture = SimulatedRig(sensor=Sensor(bit_depth=12)).render(target(), WHITE_BLACK)
    assert capture.white_level == 4095
    assert capture.images["left"]["white"].dtype == np.uint16
    assert middle(capture.images["left"]["white"]).mean() / 4095 == pytest.approx(220 / 255, abs=0.004)


def test_reading_follows_albedo_and_distance(simulated):
    read = lambda scene: middle(simulated.render(scene, WHITE_BLACK).images["left"]["white"]).mean()  # noqa: E731
    assert read(target(albedo=0.4)) == pytest.approx(1 + 219 / 2, abs=1)
    # the projector stands 85 mm off the axis: r^2 cos ratio between 500 and 600 mm
    lens = simulated.rig.projector.centre
    fall = lambda z: z / np.linalg.norm(np.array([0, 0, z]) - lens) ** 3  # noqa: E731
    assert read(target(depth=600)) == pytest.approx(4 + 216 * fall(600) / fall(500), abs=1)


def test_tilted_surfaces_get_less_light(simulated):
    turn = np.radians(50)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    tilted = slab(0.0).moved(rotation=rotation, translation=(0, 0, 500))
    scene = Scene((thing(tilted, albedo=0.8),))
    lens = simulated.rig.projector.centre - np.array([0, 0, 500.0])
    normal = rotation @ [0, 0, -1]
    expected = (lens @ normal) / (lens @ [0, 0, -1])
    white = middle(simulated.render(scene, WHITE_BLACK).images["left"]["white"], half=3).mean()
    assert white - 4 == pytest.approx(216 * expected, abs=4)


def test_highlights_saturate_where_the_mirror_direction_is(simulated):
    matt = simulated.render(target(albedo=0.5), WHITE_BLACK).images["left"]["white"]
    scene = Scene((thing(slab(500.0), albedo=0.5, specular=0.1, shininess=80.0),))
    glossy = simulated.render(scene, WHITE_BLACK).images["left"]["white"]
    # the mirror direction of the lens at (60, -60, 0) meets the plane half way, at x = 30, y = -30
    peak = simulated.rig.left.project(np.array([30.0, -30.0, 500.0])).astype(int)
    assert glossy[peak[1], peak[0]] == 255
    assert matt[peak[1], peak[0]] < 160
    corner = (slice(440, 470), slice(10, 40))
    assert glossy[corner].mean() == pytest.approx(matt[corner].mean(), rel=0.15)


def test_capture_tells_of_bad_exposure(simulated):
    fine = simulated.render(target(albedo=0.5), WHITE_BLACK)
    assert fine.record.warnings == ()
    assert fine.record.settings["exposure"]["left"] == {"saturated_percent": 0.0, "under_exposed_percent": 0.0}
    long = SimulatedRig(sensor=Sensor(exposure_us=25_000)).render(target(), WHITE_BLACK)
    assert any("left" in w and "saturated" in w for w in long.record.warnings)
    dark = simulated.render(target(albedo=0.02), WHITE_BLACK)
    assert any("right" in w and "under-exposed" in w for w in dark.record.warnings)


def test_record_names_simulated_devices(simulated):
    capture = simulated.render(target(), WHITE_BLACK)
    record = capture.record
    assert {d.role for d in record.devices} == {"left", "right", "projector"}
    assert {d.origin for d in record.devices} == {"simulated"}
    assert record.object_id == "thing"
    assert record.frame_ids == {"left": [0, 1], "right": [0, 1]}
    assert record.timestamps_ns["left"] == record.timestamps_ns["right"] == [0, 8_333_000]
    assert record.settings["exposure_us"] == 8333.0


def test_a_rig_without_projector_cannot_be_simulated(simulated):
    with pytest.raises(CalibrationError, match="projector"):
        SimulatedRig(Rig(simulated.rig.left, simulated.rig.right))
