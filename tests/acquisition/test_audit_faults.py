"""Light that is missing, too strong or of one carrier, and scenes that move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from audited_captures import BOTH, audited, dark_frame, fatal, replaced
from simulated_captures import exposed, objects_before_wall, only, plate_before_wall, simulated_rig

from drivers.simulator.materials import Material
from drivers.simulator.mix import random_scene
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import cuboid
from models.capture import Capture, Image
from models.geometry.rig import Side
from models.patterns import make_plan
from service.acquisition.finding import Fault

VIEWS = pytest.mark.parametrize("views", [("right",), BOTH], ids=["one view", "both views"])


def composite_alone(capture: Capture, name: str, views: tuple[Side, ...]) -> list[tuple[Fault, str, int | None]]:
    """What is found when a single exposure shows the pattern ``name`` to some views."""
    alone = only(capture, {"composite"})
    images = {side: {"composite": capture.images[side][name if side in views else "composite"]} for side in BOTH}
    return [(f.fault, f.device, f.index) for f in fatal(audited(alone, images))]


@VIEWS
@pytest.mark.parametrize("plan", ["full", "composite"])
def test_no_light(plan, views: tuple[Side, ...]) -> None:
    capture = only(plate_before_wall(), make_plan(plan).kinds)
    images = {
        side: {name: dark_frame(image) if side in views else image for name, image in by.items()}
        for side, by in capture.images.items()
    }
    found = fatal(audited(capture, images))
    assert [(f.fault, f.device) for f in found] == [(Fault.DARK, "projector" if len(views) == 2 else "right camera")]


@pytest.mark.parametrize("plan", ["full", "composite"])
def test_too_much_light(plan) -> None:
    capture = only(plate_before_wall(), make_plan(plan).kinds)
    bright = exposed(capture, 25.0).images["left"]
    found = fatal(audited(capture, {**capture.images, "left": bright}))
    assert [(f.fault, f.device, f.index) for f in found] == [(Fault.SATURATED, "left camera", 0)]
    assert f"exposure 0 ({capture.plan.names[0]})" in found[0].message


def test_light_without_fringes() -> None:
    """The projector shows white all the time: there is light that flickers with the noise, but no carrier."""
    capture = plate_before_wall()
    rng = np.random.default_rng(2)

    def again(image: Image) -> Image:
        return np.clip(np.rint(image * rng.uniform(0.7, 1.0)), 0, 255).astype(np.uint8)

    images = {side: {name: again(by["white"]) for name in by} for side, by in capture.images.items()}
    found = fatal(audited(capture, images))
    assert found
    assert {f.fault for f in found} <= {Fault.MODULATION, Fault.ORDER}


def test_weak_fringes_are_warned_of() -> None:
    report = audited(exposed(plate_before_wall(), 0.12))
    assert report.ok
    assert {(f.fault, f.device) for f in report.findings} == {
        (Fault.MODULATION, "left camera"),
        (Fault.MODULATION, "right camera"),
    }


def test_ambient_light_is_warned_of() -> None:
    report = audited(exposed(plate_before_wall(), 0.6, offset=70.0))
    assert report.ok
    assert sum("ambient" in warning for warning in report.warnings) == 2


@VIEWS
@pytest.mark.parametrize("name", ["high_00", "low_00", "white", "gray_06", "gray_03"])
@pytest.mark.parametrize("scene", [objects_before_wall, plate_before_wall], ids=lambda s: s.__name__)
def test_another_pattern_instead_of_a_single_composite(scene, name: str, views: tuple[Side, ...]) -> None:
    device = "projector" if len(views) == 2 else "right camera"
    assert composite_alone(scene(), name, views) == [(Fault.ORDER, device, 0)]


@VIEWS
def test_black_instead_of_a_single_composite(views: tuple[Side, ...]) -> None:
    device = "projector" if len(views) == 2 else "right camera"
    found = composite_alone(objects_before_wall(), "black", views)
    assert [(fault, of) for fault, of, _ in found] == [(Fault.DARK, device)]


class TestMotion:
    def test_the_composite_of_a_scene_shifted_by_a_pixel(self) -> None:
        for capture in (objects_before_wall(), plate_before_wall()):
            moved = {side: np.roll(capture.images[side]["composite"], 1, axis=1) for side in BOTH}
            found = fatal(audited(capture, replaced(capture, "composite", moved)))
            assert [(f.fault, f.device, f.index) for f in found] == [(Fault.MOTION, "scene", None)]

    @pytest.mark.parametrize("corner", [(180, 200), (40, 60), (300, 420)])
    def test_one_object_of_a_twentieth_of_the_field(self, corner: tuple[int, int]) -> None:
        capture = plate_before_wall()
        row, column = corner
        part = (slice(row, row + 120), slice(column, column + 128))
        moved = {}
        for side in BOTH:
            image = capture.images[side]["composite"].copy()
            image[part] = np.roll(image, 1, axis=1)[part]
            moved[side] = image
        found = fatal(audited(capture, replaced(capture, "composite", moved)))
        assert [(f.fault, f.device) for f in found] == [(Fault.MOTION, "scene")]

    @pytest.mark.parametrize(
        ("moved_by", "since"),
        [
            ((0.0, 0.0, 4.0), "high_00"),
            ((1.5, 0.0, 0.0), "low_00"),
            ((0.0, 1.5, 0.0), "low_00"),
            ((1.5, 0, 0), "low_06"),
        ],
    )
    def test_an_object_that_moves_between_exposures(self, moved_by: tuple[float, float, float], since: str) -> None:
        """A plate of 110 x 80 mm with edges; from one exposure on it stands elsewhere."""
        plan = make_plan("full")
        before, after = (plate_at(0.0, 0.0, 0.0), plate_at(*moved_by))
        begin = plan.names.index(since)
        images = {
            side: {n: (before if k < begin else after).images[side][n] for k, n in enumerate(plan.names)}
            for side in BOTH
        }
        found = fatal(audited(before, images))
        assert [(f.fault, f.device) for f in found] == [(Fault.MOTION, "scene")]

    def test_a_drifting_lamp_is_no_motion(self) -> None:
        capture = objects_before_wall()
        names = capture.plan.names
        images = {
            side: {n: np.rint(by[n] * (1 - 0.08 * k / len(names))).astype(np.uint8) for k, n in enumerate(names)}
            for side, by in capture.images.items()
        }
        assert audited(capture, images).ok

    def test_noise_and_gloss_are_no_motion(self) -> None:
        capture = simulated_rig().render(random_scene(4242, 16), make_plan("full"), 77)
        again = simulated_rig().render(random_scene(4242, 16), make_plan("full"), 78)
        mixed = {
            side: {n: (capture if k % 2 else again).images[side][n] for k, n in enumerate(capture.plan.names)}
            for side in BOTH
        }
        assert audited(replace(capture, images=mixed)).ok


def plate_at(x: float, y: float, z: float) -> Capture:
    plate = SceneObject("plate", cuboid((110.0, 80.0, 2.0), (20.0 + x, 10.0 + y, 481.0 + z)), Material(albedo=0.7))
    wall = SceneObject("wall", cuboid((900.0, 900.0, 2.0), (0.0, 0.0, 601.0)), Material(albedo=0.4))
    return simulated_rig().render(Scene((plate,), wall), make_plan("full"), 8)
