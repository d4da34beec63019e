"""Ground truth on the left sensor's grid: what the ray through each pixel's centre meets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from drivers.simulator.lamp import Lamp
from drivers.simulator.optics import project_points
from drivers.simulator.scene import Scene
from models.capture import Truth
from models.geometry.device import Device
from models.geometry.rig import Rig


def scene_truth(scene: Scene, rig: Rig, lamp: Lamp) -> Truth:
    """Truth of a scene.

    depth: mm, NaN where the left camera meets nothing. projector_column (u): NaN where there is no surface or it lies
    outside the raster. foreground: lit, seen by both cameras and within ``rig.working_depths``.
    extra: "projector_row" (v) float32 as the column; "lit" and "covisible" bool; "object_index" int16, -1 where there
    is nothing, else the number of the object in the scene, the wall last; "right_projector_column" float32 on the
    right sensor's grid, NaN where the lamp's light does not reach what it sees.
    """
    shape = (rig.left.height, rig.left.width)
    hits = scene.tracer.cast(rig.left.centre, rig.left.rays(rig.left.pixel_grid()).reshape(-1, 3))
    falling = lamp.falling_on(hits, scene.tracer)
    depth = np.where(hits.hit, hits.points[:, 2], np.nan)

    covisible = hits.hit & rig.right.contains(project_points(rig.right, hits.points))
    covisible &= np.einsum("ij,ij->i", rig.right.centre - hits.points, hits.facets) > 0
    seen = np.flatnonzero(covisible)
    covisible[seen] = scene.tracer.sees(hits.lifted_at(seen), rig.right.centre)

    near, far = rig.working_depths
    in_range = hits.hit & (hits.points[:, 2] >= near) & (hits.points[:, 2] <= far)
    on_raster = hits.hit & lamp.device.contains(falling.mirrors)
    column, row = np.where(on_raster[:, None], falling.mirrors, np.float32(np.nan)).T
    return Truth(
        depth=depth.reshape(shape).astype(np.float32),
        projector_column=column.reshape(shape),
        foreground=(falling.lit & covisible & in_range).reshape(shape),
        extra={
            "projector_row": row.reshape(shape),
            "lit": falling.lit.reshape(shape),
            "covisible": covisible.reshape(shape),
            "object_index": hits.objects.reshape(shape),
            "right_projector_column": _column_seen_by(rig.right, scene, lamp),
        },
    )


def _column_seen_by(camera: Device, scene: Scene, lamp: Lamp) -> npt.NDArray[np.float32]:
    hits = scene.tracer.cast(camera.centre, camera.rays(camera.pixel_grid()).reshape(-1, 3))
    falling = lamp.falling_on(hits, scene.tracer)
    column = np.where(falling.lit, falling.mirrors[:, 0], np.float32(np.nan))
    return np.asarray(column.reshape(camera.height, camera.width), np.float32)
