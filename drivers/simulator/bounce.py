"""One diffuse bounce: projector light that reaches a surface by way of another one.

Bounced light varies slowly, so it is gathered at one point in 4 x 4 pixels and spread over each object separately.
Like the direct light it is a sum over projector coordinates, so that any pattern can be applied afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from drivers.simulator.lamp import Lamp
from drivers.simulator.optics import Profile, gather
from drivers.simulator.raycast import Hits
from drivers.simulator.scene import Scene
from models.geometry.device import Device

Float32Array = npt.NDArray[np.float32]
CELL_PX = 4
RAYS = 64
"""Directions a point is lit from; smoothing over neighbouring cells adds to their number."""
_SMOOTHING_CELLS = 1.0
_POINTS_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Bounce:
    """Indirect light of one view.

    gain, columns, rows: float32 (h, w, RAYS) over cells of 4 x 4 pixels, as in ``ViewLight`` but per unit of albedo.
    cell_objects, objects: int16 (h, w) and (H, W), which object a cell's centre or a pixel shows.
    """

    gain: Float32Array
    columns: Float32Array
    rows: Float32Array
    cell_objects: npt.NDArray[np.int16]
    objects: npt.NDArray[np.int16]

    def under(self, profile: Profile) -> Float32Array:
        """Light (H, W) under one pattern per unit of albedo."""
        dark = np.zeros(self.cell_objects.shape, np.float32)
        cells = gather(self.gain, self.rows if profile.row_coded else self.columns, profile, dark)
        out = np.zeros(self.objects.shape, np.float32)
        for index in range(int(self.objects.max(initial=-1)) + 1):
            own = (self.cell_objects == index).astype(np.float32)
            weight = self._spread(own)
            light = self._spread(own * cells) / np.maximum(weight, np.float32(1e-6))
            out += np.where((self.objects == index) & (weight > 1e-6), light, np.float32(0))
        return out

    def _spread(self, cells: Float32Array) -> Float32Array:
        height, width = self.objects.shape
        smooth = cv2.GaussianBlur(cells, (0, 0), _SMOOTHING_CELLS)
        grown = cv2.resize(smooth, None, fx=CELL_PX, fy=CELL_PX, interpolation=cv2.INTER_LINEAR)
        return np.asarray(grown[:height, :width], np.float32)


def view_bounce(scene: Scene, camera: Device, lamp: Lamp, objects: npt.NDArray[np.int16]) -> Bounce:
    """Gather the light that reaches what a camera sees after one diffuse reflection.

    objects: int16 (H, W), what each pixel of the camera shows. The directions are the same in every call.
    """
    height, width = -(-camera.height // CELL_PX), -(-camera.width // CELL_PX)
    y, x = np.mgrid[0:height, 0:width] * CELL_PX + (CELL_PX - 1) / 2
    seen = scene.tracer.cast(camera.centre, camera.rays(np.stack([x, y], -1)).reshape(-1, 3))
    shape = (height * width, RAYS)
    gain, columns, rows = (np.zeros(shape, np.float32) for _ in range(3))
    turns = np.random.default_rng(4).random((height * width, 2))
    on_surface = np.flatnonzero(seen.hit)
    for start in range(0, len(on_surface), _POINTS_AT_ONCE):
        part = on_surface[start : start + _POINTS_AT_ONCE]
        directions = _cosine_directions(seen.normals[part].astype(np.float64), turns[part]).reshape(-1, 3)
        others: Hits = scene.tracer.cast(np.repeat(seen.lifted_at(part), RAYS, axis=0), directions)
        falling = lamp.falling_on(others, scene.tracer)
        above = np.einsum("ij,ij->i", directions, np.repeat(seen.facets[part], RAYS, axis=0)) > 0
        passed_on = scene.albedo_at(others) * falling.strength * above / np.float32(np.pi)
        gain[part] = passed_on.reshape(-1, RAYS)
        columns[part] = falling.mirrors[:, 0].reshape(-1, RAYS)
        rows[part] = falling.mirrors[:, 1].reshape(-1, RAYS)
    cells = (height, width, RAYS)
    return Bounce(
        gain.reshape(cells), columns.reshape(cells), rows.reshape(cells), seen.objects.reshape(height, width), objects
    )


def _cosine_directions(normals: npt.NDArray[np.float64], turns: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Directions (N, RAYS, 3) about normals (N, 3), as dense as the cosine; turns (N, 2) decorrelate the points.

    The low-discrepancy sequence is Martin Roberts's R2 (2018), turned point by point (Cranley and Patterson, 1976).
    """
    k = np.arange(RAYS)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    first, second = np.moveaxis((turns[:, None, :] + k) % 1.0, -1, 0)
    radius, angle, height = np.sqrt(first), 2 * np.pi * second, np.sqrt(1 - first)
    aside = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(normals, aside)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    other = np.cross(normals, tangent)
    along = (radius * np.cos(angle))[..., None] * tangent[:, None] + (radius * np.sin(angle))[..., None] * other[
        :, None
    ]
    return np.asarray(along + height[..., None] * normals[:, None])
