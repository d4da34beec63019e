"""Epipolar rectification on canvases that cover the whole field of both cameras.

OpenCV's default keeps the canvas at sensor size and cuts off what toed-in cameras see in common; here each view gets
the canvas it needs. Rectified frame: x along the baseline from the left to the right camera, z between the optical
axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from models.errors import CalibrationError
from models.geometry.device import Device
from models.geometry.rig import SIDES, Rig, Side

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
_LARGEST_GROWTH = 2.5


@dataclass(frozen=True, eq=False)
class Rectification:
    """Two virtual cameras with parallel axes, common rows and a common focal length.

    rotation: (3, 3), left-camera frame to rectified frame. focal: px. baseline: mm. cy: px, common.
    cx: principal column of each canvas. sizes: (width, height) of each canvas; heights are equal.
    maps: per side, float32 (height, width, 2), sensor pixel shown by each canvas pixel (for cv2.remap).
    canvas_of_left: float32 (H, W, 2), canvas coordinates of every pixel of the left sensor.
    """

    rotation: FloatArray
    focal: float
    baseline: float
    cx: dict[Side, float]
    cy: float
    sizes: dict[Side, tuple[int, int]]
    maps: dict[Side, Float32Array]
    canvas_of_left: Float32Array

    def depth_row(self) -> FloatArray:
        """Row vector (3,) that gives left-camera z of a rectified point by its dot product."""
        return np.asarray(self.rotation[:, 2], np.float64).copy()

    def left_rays(self) -> FloatArray:
        """Lines of sight of the left sensor's pixels, (H, W, 3), left-camera frame with z = 1."""
        plane = self.canvas_of_left.astype(np.float64) - (self.cx["left"], self.cy)
        rays = np.concatenate([plane, np.full((*plane.shape[:2], 1), self.focal)], axis=-1) @ self.rotation
        return np.asarray(rays / rays[..., 2:])

    def triangulate(self, x_left: npt.ArrayLike, x_right: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Left-frame points (..., 3), mm, of matching canvas columns on canvas row(s) y; NaN where rays do not meet."""
        across = np.asarray(x_left, np.float64) - self.cx["left"]
        disparity = across - (np.asarray(x_right, np.float64) - self.cx["right"])
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(disparity > 0, self.baseline / disparity, np.nan)
        down = np.asarray(y, np.float64) - self.cy
        local = np.stack([across * scale, down * scale, self.focal * scale], axis=-1)
        return np.asarray(local @ self.rotation, np.float64)

    def canvas_coordinates(self, side: Side, points: npt.ArrayLike) -> FloatArray:
        """Canvas pixels (..., 2) of left-frame points (..., 3), mm."""
        local = np.asarray(points, np.float64) @ self.rotation.T
        shift = self.baseline if side == "right" else 0.0
        x = self.focal * (local[..., 0] - shift) / local[..., 2] + self.cx[side]
        y = self.focal * local[..., 1] / local[..., 2] + self.cy
        return np.stack([x, y], axis=-1)


@lru_cache(maxsize=8)
def rectify(rig: Rig) -> Rectification:
    """Build the rectification of a rig, once per calibration.

    Raises CalibrationError for cameras that cannot be rectified.
    """
    rotation = _rectifying_rotation(rig)
    focal = float(np.mean([d.fx for d in rig.cameras.values()] + [d.fy for d in rig.cameras.values()]))
    boxes = {side: _footprint(device, rotation, focal) for side, device in rig.cameras.items()}
    top = np.ceil(max(box[0, 1] for box in boxes.values()))
    bottom = np.floor(min(box[1, 1] for box in boxes.values()))
    height = int(bottom - top) + 1
    if height < 8:
        raise CalibrationError("the two cameras share no rows after rectification; are the views of one rig?")
    cx: dict[Side, float] = {}
    sizes: dict[Side, tuple[int, int]] = {}
    for side in SIDES:
        left_edge = np.floor(boxes[side][0, 0])
        width = int(np.ceil(boxes[side][1, 0]) - left_edge) + 1
        if width * height > _LARGEST_GROWTH**2 * rig.left.width * rig.left.height:
            raise CalibrationError(f"{side} camera: looks too far along the baseline to be rectified")
        cx[side] = -float(left_edge)
        sizes[side] = (width, height)
    cy = -float(top)
    maps = {s: _sensor_map(d, rotation, focal, cx[s], cy, sizes[s]) for s, d in rig.cameras.items()}
    rays = rig.left.rays(rig.left.pixel_grid()) @ rotation.T
    canvas = np.stack([focal * rays[..., 0] / rays[..., 2] + cx["left"], focal * rays[..., 1] / rays[..., 2] + cy], -1)
    baseline = float(np.linalg.norm(rig.right.centre - rig.left.centre))
    return Rectification(rotation, focal, baseline, cx, cy, sizes, maps, canvas.astype(np.float32))


def _rectifying_rotation(rig: Rig) -> FloatArray:
    x_axis = rig.right.centre - rig.left.centre
    x_axis = x_axis / np.linalg.norm(x_axis)
    forward = rig.left.rotation[2] + rig.right.rotation[2]
    y_axis = np.cross(forward, x_axis)
    if np.linalg.norm(y_axis) < 0.2 * np.linalg.norm(forward) or np.linalg.norm(forward) < 0.2:
        raise CalibrationError(
            "one camera looks along the baseline or away from the other; the rig cannot be rectified"
        )
    y_axis = y_axis / np.linalg.norm(y_axis)
    return np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)])


def _footprint(device: Device, rotation: FloatArray, focal: float) -> FloatArray:
    """Bounding box [[x0, y0], [x1, y1]] of a sensor's border on the rectified plane, px about the principal point."""
    w, h = device.width - 1.0, device.height - 1.0
    t = np.linspace(0, 1, 65)
    border = np.concatenate(
        [np.stack(p, -1) for p in ((w * t, 0 * t), (w * t, h + 0 * t), (0 * t, h * t), (w + 0 * t, h * t))]
    )
    rays = device.rays(border) @ rotation.T
    if (rays[:, 2] < 0.1).any():
        raise CalibrationError(f"{device.name} camera: part of the sensor looks away from the rectified view")
    flat = focal * rays[:, :2] / rays[:, 2:]
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


def _sensor_map(
    device: Device, rotation: FloatArray, focal: float, cx: float, cy: float, size: tuple[int, int]
) -> Float32Array:
    y, x = np.mgrid[0 : size[1], 0 : size[0]].astype(np.float64)
    rays = np.stack([(x - cx) / focal, (y - cy) / focal, np.ones_like(x)], axis=-1).reshape(-1, 3)
    turn, _ = cv2.Rodrigues(device.rotation @ rotation.T)
    pixels, _ = cv2.projectPoints(rays, turn, np.zeros(3), device.matrix, device.distortion)
    return pixels.reshape(size[1], size[0], 2).astype(np.float32)
