"""Normals of planes, spheres and steps whose true normals are known."""

from __future__ import annotations

import time

import numpy as np
import pytest

from models.normals import estimate_normals

HEIGHT, WIDTH = 120, 160
V, U = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
RAYS = np.stack([(U - 79.5) / 1000, (V - 59.5) / 1000, np.ones_like(U)], axis=-1)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between unit vectors; NaN where either is."""
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2, 0, 1)))


def plane(normal: tuple[float, float, float], distance: float = 500) -> tuple[np.ndarray, np.ndarray]:
    """Points of the plane through (0, 0, distance) and its unit normal towards the camera."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    return (RAYS * (n[2] * distance / (RAYS @ n))[..., None]), -n


def noisy(points: np.ndarray, sigma: float) -> np.ndarray:
    """Points moved along their rays by depth noise, mm."""
    noise = np.random.default_rng(0).normal(0, sigma, points.shape[:2])
    return (points * (1 + noise / points[..., 2])[..., None]).astype(np.float32)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.6, 0, 1), (-0.5, 0.8, 1), (2, 1, 1), (0, -3, 1)])
def test_a_plane_has_one_normal(normal):
    points, expected = plane(normal)
    estimated = estimate_normals(points.astype(np.float32))
    assert (estimated.dtype, estimated.shape) == (np.float32, points.shape)
    assert np.nanmax(angle(estimated, expected)) < 0.05
    assert not np.isnan(estimated).any()
    np.testing.assert_allclose(np.linalg.norm(estimated, axis=-1), 1, atol=1e-6)


@pytest.mark.parametrize(("sigma", "median", "high"), [(0.04, 1.0, 2.5), (0.1, 2.5, 6.0)])
def test_noise_is_averaged(sigma, median, high):
    points, expected = plane((0.2, -0.3, 1))
    error = angle(estimate_normals(noisy(points, sigma)), expected)
    assert np.median(error) < median
    assert np.percentile(error, 99) < high


def sphere(radius: float, centre: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    c = np.asarray(centre)
    along, square = RAYS @ c, (RAYS**2).sum(axis=-1)
    root = along**2 - square * (c @ c - radius**2)
    z = np.where(root > 0, (along - np.sqrt(np.maximum(root, 0))) / square, np.nan)
    points = RAYS * z[..., None]
    return points, (points - c) / radius


@pytest.mark.parametrize(("steepness", "bound"), [(0.7, 0.2), (0.5, 0.5), (0.25, 2.0)])
def test_a_sphere_has_radial_normals_almost_to_its_edge(steepness, bound):
    points, expected = sphere(25, (0, 0, 500))
    estimated = estimate_normals(points.astype(np.float32))
    facing = -(expected * RAYS).sum(axis=-1) / np.linalg.norm(RAYS, axis=-1)
    inner = facing > steepness
    assert inner.mean() > 0.2
    assert angle(estimated, expected)[inner].max() < bound
    assert np.isnan(estimated[np.isnan(points[..., 2])]).all()


@pytest.mark.parametrize("height", [2.0, 5.0, 100.0, -30.0])
@pytest.mark.parametrize("vertical", [True, False])
def test_normals_do_not_bend_across_a_step(height, vertical):
    near = ((U if vertical else V) < 50)[..., None]
    front = RAYS * (500 + 0.2 * U + 0.1 * V)[..., None]
    back = front + RAYS * height
    stepped = estimate_normals(np.where(near, front, back).astype(np.float32))
    apart = np.where(near, estimate_normals(front.astype(np.float32)), estimate_normals(back.astype(np.float32)))
    assert angle(stepped, apart).max() < 0.1


def test_normals_do_not_bend_across_a_noisy_step():
    points = noisy(RAYS * np.where(U < 80, 500, 508)[..., None], 0.04)
    error = angle(estimate_normals(points), np.array([0, 0, -1.0]))
    assert np.median(error[:, 77:83]) < 2
    assert np.percentile(error[:, 77:83], 99) < 8


def test_normals_point_towards_the_camera():
    points, _ = sphere(25, (0, 0, 500))
    estimated = estimate_normals(points.astype(np.float32))
    known = np.isfinite(estimated[..., 2])
    assert (np.sum(estimated * points, axis=-1)[known] < 0).all()
    assert (estimated[known][:, 2] < 0).all()


def test_holes_and_lone_points_have_no_normal():
    points, expected = plane((0.1, 0.2, 1))
    points[40:60, 40:60] = np.nan
    points[50, 50] = RAYS[50, 50] * 500  # alone
    points[80:100, 80:100] = np.nan
    points[90, 80:100] = RAYS[90, 80:100] * 500  # one line of points tells no plane
    estimated = estimate_normals(points.astype(np.float32))
    assert np.isnan(estimated[50, 50]).all()
    assert np.isnan(estimated[90, 85:95]).all()
    assert np.isnan(estimated[45, 45]).all()
    far = np.isfinite(points[..., 2])
    far[38:62, 38:62] = far[78:102, 78:102] = False
    assert angle(estimated, expected)[far].max() < 0.05


def test_nothing_known_gives_nothing():
    assert np.isnan(estimate_normals(np.full((5, 7, 3), np.nan, np.float32))).all()
    assert estimate_normals(np.empty((0, 7, 3), np.float32)).shape == (0, 7, 3)


def test_scale_does_not_matter():
    points = sphere(25, (5, 3, 500))[0].astype(np.float32)
    np.testing.assert_allclose(estimate_normals(points / 1024), estimate_normals(points), atol=1e-6)


def test_a_full_sensor_takes_a_moment():
    points = np.tile(RAYS.astype(np.float32) * 500, (4, 4, 1))
    estimate_normals(points)
    best = min(_timed(points) for _ in range(5))
    assert best < 0.25  # 0.03 s on two idle cores


def _timed(points: np.ndarray) -> float:
    start = time.perf_counter()
    estimate_normals(points)
    return time.perf_counter() - start
