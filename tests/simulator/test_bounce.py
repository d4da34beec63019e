"""One diffuse bounce between surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_scenes import middle, slab, target, thing

from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from drivers.simulator.sensor import Sensor
from models.patterns import make_plan

SENSOR = Sensor(exposure_us=4000, noiseless=True, bit_depth=12)
PLAN = make_plan("full").restricted_to(["white", "black"])


DIRECT = SimulatedRig(sensor=SENSOR)
BOTH = SimulatedRig(sensor=SENSOR, interreflection=True)


def white(scene: Scene, *, bounce: bool) -> np.ndarray:
    capture = (BOTH if bounce else DIRECT).render(scene, PLAN)
    return capture.images["left"]["white"].astype(float)


def groove(albedo: float) -> Scene:
    """Two long walls at a right angle, open towards the rig, their edge at 600 mm."""
    turn = np.sqrt(0.5)
    sides = []
    for sign in (-1, 1):
        rotation = np.array([[turn, 0, sign * turn], [0, 1, 0], [-sign * turn, 0, turn]])
        side = slab(0.0, (300.0, 400.0), (sign * 150.0, 0.0)).moved(rotation=rotation, translation=(0, 0, 600))
        sides.append(thing(side, f"side{sign}", albedo=albedo))
    return Scene(tuple(sides))


def test_a_lone_plane_gets_no_bounced_light():
    assert np.array_equal(white(target(), bounce=False), white(target(), bounce=True))


@pytest.mark.parametrize("albedo", [0.4, 0.8])
def test_a_groove_brightens_by_the_form_factor(albedo):
    """Beside the edge of a right-angled groove the form factor to the other wall is 1/2 (1 - cos 90 deg) = 1/2.

    Both walls are about equally lit there, so one bounce adds albedo / 2 to the light.
    """
    direct, both = white(groove(albedo), bounce=False), white(groove(albedo), bounce=True)
    base = 1.0 / 255 * 4095  # black level
    # the edge stands at x = 0; a few pixels beside it, on either side
    column = int(DIRECT.rig.left.project(np.array([0.0, 0.0, 600.0]))[0])
    near = [(slice(220, 260), slice(column + s, column + s + 6)) for s in (-14, 9)]
    gains = [(both[at] - direct[at]).mean() / (direct[at] - base).mean() for at in near]
    assert np.mean(gains) == pytest.approx(albedo / 2, rel=0.15)


def test_bounced_light_fills_no_gap_in_depth():
    """A plate well before a wall: its light does not leak across the silhouette onto the wall's own map."""
    scene = Scene((thing(slab(450.0, (80.0, 80.0)), albedo=0.8),), thing(slab(640.0), "wall", albedo=0.05))
    direct, both = white(scene, bounce=False), white(scene, bounce=True)
    assert middle(both).mean() == pytest.approx(middle(direct).mean(), rel=0.01)
    assert (both >= direct - 1).all()


def test_bounce_carries_low_frequencies_of_the_pattern():
    """Fringes reach a surface twice: directly, and washed out by the other surface, so that their contrast falls."""
    plan = make_plan("reference").restricted_to([f"high_{k:02d}" for k in range(9)])
    contrast = []
    for simulated in (DIRECT, BOTH):
        capture = simulated.render(groove(0.8), plan)
        stack = capture.stack("left", "high")
        z = np.tensordot(np.exp(2j * np.pi * np.arange(9) / 9), stack, 1) * 2 / 9
        contrast.append(float(np.median(np.abs(z)[200:280, 330:400] / stack.mean(axis=0)[200:280, 330:400])))
    assert contrast[1] < 0.85 * contrast[0]
