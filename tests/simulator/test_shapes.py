"""Procedural shapes, materials and the rays that meet them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_scenes import slab

from drivers.simulator.coverage import silhouette
from drivers.simulator.geometry import reference_rig
from drivers.simulator.materials import TEXTURES, Material
from drivers.simulator.meshes import Mesh
from drivers.simulator.noise import fractal_noise
from drivers.simulator.raycast import Tracer
from drivers.simulator.shapes import SHAPES, SMOOTH, cuboid, rod, unit_sphere


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", [0, 1])
def test_shape_fills_the_unit_sphere(name, seed):
    mesh = SHAPES[name](np.random.default_rng(seed))
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1)
    assert np.abs(mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)).max() < 1e-9
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    used = np.unique(mesh.faces)
    assert np.allclose(np.linalg.norm(mesh.normals[used], axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_same_generator_same_shape(name):
    first, again = (SHAPES[name](np.random.default_rng(8)) for _ in range(2))
    assert np.array_equal(first.vertices, again.vertices)


@pytest.mark.parametrize("name", SMOOTH)
def test_closed_shapes_are_hit_from_every_side(name):
    mesh = SHAPES[name](np.random.default_rng(3))
    tracer = Tracer([mesh])
    eyes = np.random.default_rng(0).normal(size=(200, 3))
    eyes *= 5 / np.linalg.norm(eyes, axis=1, keepdims=True)
    # aim at a point just under the surface, from everywhere
    inside = 0.999 * mesh.vertices[mesh.faces[0]].mean(axis=0) - 0.001 * mesh.normals[mesh.faces[0, 0]]
    assert tracer.cast(eyes, inside - eyes).hit.all()


def test_smooth_normals_of_a_sphere_are_radial():
    ball = Mesh.smooth(*unit_sphere())
    assert np.einsum("ij,ij->i", ball.normals, ball.vertices).min() > 1 - 1e-5


def test_edges_of_a_box_stay_sharp():
    normals = cuboid((1.0, 2.0, 3.0)).normals
    assert np.allclose(np.sort(np.abs(normals), axis=1), [0, 0, 1], atol=1e-12)


def test_round_shapes_have_no_seam():
    """Vertices at the same place on a tube's side share their normal."""
    for mesh in (SHAPES["torus"](np.random.default_rng(0)), rod(1.0, 2.0)):
        side = np.abs(mesh.normals[:, 1]) < 0.9
        places, which = np.unique(np.round(mesh.vertices[side], 6), axis=0, return_inverse=True)
        mean = np.zeros_like(places)
        np.add.at(mean, which, mesh.normals[side])
        mean /= np.bincount(which)[:, None]
        assert np.abs(mean[which] - mesh.normals[side]).max() < 0.02


def test_rod_has_its_size():
    bar = rod(2.0, 30.0, (1.0, 2.0, 3.0))
    assert np.allclose(np.ptp(bar.vertices, axis=0), [4, 30, 4])
    assert np.allclose((bar.vertices.max(axis=0) + bar.vertices.min(axis=0)) / 2, [1, 2, 3])


def test_rays_meet_a_sphere_where_algebra_says():
    ball = Mesh.smooth(*unit_sphere()).moved(80.0, translation=(10, -5, 500))
    rng = np.random.default_rng(1)
    directions = np.c_[rng.uniform(-0.1, 0.1, (400, 2)), np.ones(400)]
    hits = Tracer([ball]).cast(np.zeros(3), directions)
    centre = np.array([10.0, -5.0, 500.0])
    a, b, c = (directions**2).sum(1), directions @ centre, centre @ centre - 6400
    expected = directions * ((b - np.sqrt(b * b - a * c)) / a)[:, None]
    assert hits.hit.all()
    assert np.abs(hits.points - expected).max() < 0.03  # faces are chords of the sphere
    assert np.abs(np.linalg.norm(hits.normals, axis=1) - 1).max() < 1e-5
    radial = (expected - centre) / 80
    assert np.einsum("ij,ij->i", hits.normals, radial).min() > 0.9999
    assert (np.einsum("ij,ij->i", hits.facets, directions) < 0).all()  # turned to where the ray came from


def test_normals_turn_to_the_viewer_on_both_sides_of_a_sheet():
    sheet = Tracer([slab(500.0)])
    front = sheet.cast(np.zeros(3), np.array([[0.0, 0.0, 1.0]]))
    back = sheet.cast(np.array([0.0, 0.0, 1000.0]), np.array([[0.0, 0.0, -1.0]]))
    assert front.normals[0, 2] == pytest.approx(-1)
    assert back.normals[0, 2] == pytest.approx(1)


def test_line_of_sight_ends_at_its_target():
    tracer = Tracer([slab(500.0, (100.0, 100.0))])
    points = np.array([[0.0, 0.0, 400.0], [0.0, 0.0, 600.0], [0.0, 200.0, 600.0]])
    assert tracer.sees(points, np.zeros(3)).tolist() == [True, False, True]
    assert tracer.sees(points[:1], np.array([0.0, 0.0, 450.0])).all()


def test_empty_scene_is_missed():
    tracer = Tracer([])
    assert not tracer.cast(np.zeros(3), np.ones((4, 3))).hit.any()
    assert tracer.sees(np.ones((4, 3)), np.zeros(3)).all()


def test_silhouette_counts_what_rays_hit():
    camera = reference_rig().left
    blob = SHAPES["blob"](np.random.default_rng(5)).moved(90.0, translation=(30, 10, 500))
    pixels = camera.pixel_grid()[1::4, 1::4]
    hit = Tracer([blob]).cast(camera.centre, camera.rays(pixels).reshape(-1, 3)).hit
    assert silhouette(blob, camera).mean() == pytest.approx(hit.mean(), abs=0.01)


@pytest.mark.parametrize("texture", TEXTURES)
def test_texture_stays_within_its_contrast(texture):
    material = Material(albedo=0.7, texture=texture, contrast=0.8, scale_mm=12.0, seed=5)
    points = np.random.default_rng(0).uniform([-100, -100, 400], [100, 100, 600], (20_000, 3))
    albedo = material.albedo_at(points)
    assert albedo.min() >= 0.7 * 0.2 - 1e-6
    assert albedo.max() <= 0.7 + 1e-6
    assert np.percentile(albedo, 95) / np.percentile(albedo, 5) > 2.5
    assert np.array_equal(albedo, material.albedo_at(points))


def test_texture_has_features_of_its_size():
    """Close points look alike, points several features apart do not."""
    material = Material(albedo=1.0, texture="marble", contrast=1.0, scale_mm=20.0, seed=1)
    rng = np.random.default_rng(0)
    points = rng.uniform(-300, 300, (20_000, 3))
    here = material.albedo_at(points)
    near, far = (np.corrcoef(here, material.albedo_at(points + np.array([d, 0, 0])))[0, 1] for d in (1, 60))
    assert near > 0.95
    assert abs(far) < 0.1


@given(st.integers(0, 2**31 - 1))
def test_noise_is_bounded_smooth_and_zero_mean(seed):
    points = np.random.default_rng(seed).uniform(-50, 50, (2000, 3))
    noise = fractal_noise(points, seed)
    assert np.abs(noise).max() <= 1.1
    assert abs(noise.mean()) < 0.05
    assert np.abs(fractal_noise(points + 1e-4, seed) - noise).max() < 5e-3
