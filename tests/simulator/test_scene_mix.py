"""The default mix of scenes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulator.geometry import reference_rig
from drivers.simulator.mix import random_rotation, random_scene, rotation, traits_of
from drivers.simulator.scene import Scene
from drivers.simulator.shapes import FINE
from models.geometry.device import Device
from models.geometry.rig import Rig

RIG = reference_rig()


@pytest.fixture(scope="module", params=[0, 2026])
def twelve(request) -> list[Scene]:
    """Any twelve scenes in a row; these do not start at a multiple of twelve."""
    return [random_scene(request.param, i) for i in range(5, 17)]


def cover_of_objects(scene: Scene, rig: Rig = RIG) -> float:
    """Share of the left camera's pixels whose centre shows an object, not the wall, between 400 and 670 mm."""
    pixels = rig.left.pixel_grid()[1::4, 1::4].reshape(-1, 2)
    hits = scene.tracer.cast(rig.left.centre, rig.left.rays(pixels))
    near, far = rig.working_depths
    in_range = hits.hit & (hits.points[:, 2] >= near) & (hits.points[:, 2] <= far)
    return float((in_range & (hits.objects < len(scene.objects))).mean())


def test_objects_cover_a_third_of_the_field(twelve):
    assert min(cover_of_objects(scene) for scene in twelve) >= 0.35


def test_two_are_dark(twelve):
    dark = [s for s in twelve if all(o.material.albedo < 0.2 for o in s.objects)]
    assert len(dark) >= 2


def test_two_have_strong_texture(twelve):
    strong = [s for s in twelve if all(o.material.texture != "none" and o.material.contrast >= 0.6 for o in s.objects)]
    assert len(strong) >= 2


def test_two_are_glossy(twelve):
    assert sum(all(o.material.specular > 0 for o in s.objects) for s in twelve) >= 2


def test_three_have_stairs_or_thin_parts(twelve):
    assert sum(any(o.name.split("-")[0] in FINE for o in s.objects) for s in twelve) >= 3


def test_half_have_a_back_wall_that_nothing_pierces(twelve):
    walled = [s for s in twelve if s.wall is not None]
    assert len(walled) == 6
    for scene in walled:
        front = scene.wall.mesh.vertices[scene.wall.mesh.vertices[:, 2].argsort()]
        normal = scene.wall.mesh.normals[0]
        towards = normal if normal[2] < 0 else -normal
        plane = max(float(v @ towards) for v in front)
        for thing in scene.objects:
            in_field = RIG.left.contains(RIG.left.project(thing.mesh.vertices))
            assert float((thing.mesh.vertices[in_field] @ towards).min()) > plane


def test_objects_stand_in_the_working_range(twelve):
    for scene in twelve:
        for thing in scene.objects:
            depths = thing.mesh.vertices[:, 2]
            assert depths.min() > 400
            assert depths.max() < 670


def test_shapes_and_depths_vary(twelve):
    shapes = {o.name.split("-")[0] for s in twelve for o in s.objects}
    assert len(shapes) >= 7
    assert np.std([o.mesh.vertices[:, 2].mean() for s in twelve for o in s.objects]) > 20


def test_identities_are_unique(twelve):
    ids = [s.object_id for s in twelve]
    names = [n for i in ids for n in i.split("+")]
    assert len(set(ids)) == len(ids)
    assert len(set(names)) == len(names)


@given(st.integers(0, 2**32), st.integers(0, 10_000))
def test_every_twelve_in_a_row_have_the_mix(seed, start):
    traits = [traits_of(seed, i) for i in range(start, start + 12)]
    count = lambda name: sum(name in t for t in traits)  # noqa: E731
    assert (count("dark"), count("textured"), count("glossy"), count("fine"), count("wall")) == (2, 3, 3, 4, 6)


def test_seeds_order_the_traits_differently():
    orders = [tuple(traits_of(seed, i) for i in range(12)) for seed in range(6)]
    assert all(a != b for a, b in combinations(orders, 2))


def test_scene_depends_on_seed_and_index_only():
    first, again = random_scene(3, 4), random_scene(3, 4)
    assert first.object_id == again.object_id
    for one, other in zip(first.surfaces, again.surfaces, strict=True):
        assert np.array_equal(one.mesh.vertices, other.mesh.vertices)
        assert one.material == other.material
    assert random_scene(3, 5).object_id != first.object_id != random_scene(4, 4).object_id


def test_another_rig_is_filled_as_well():
    """Half the size in every length: objects follow the rig's own field and range."""
    small = Rig(
        Device((320, 240), [[700, 0, 160], [0, 700, 120], [0, 0, 1]], np.zeros(5)),
        RIG.right,
        RIG.projector,
        RIG.raster,
        {"working_range_mm": [200, 335]},
    )
    for index in range(4):
        scene = random_scene(0, index, small)
        assert cover_of_objects(scene, small) > 0.35
        assert min(o.mesh.vertices[:, 2].min() for o in scene.objects) > 200


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 2**32))
def test_rotations_are_rotations(yaw, pitch, roll, seed):
    for matrix in (rotation(yaw, pitch, roll), random_rotation(np.random.default_rng(seed))):
        assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1)


def test_positive_pitch_shows_the_upper_side():
    upper = rotation(0.0, 0.5, 0.0) @ np.array([0.0, -1.0, 0.0])  # normal of the upper side, y points down
    assert upper[2] < 0  # turned to the camera
