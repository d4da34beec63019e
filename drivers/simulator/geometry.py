"""The reference geometry: two cameras and a projector whose axes meet half a metre away."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from models.geometry.device import Device
from models.geometry.rig import Rig
from models.patterns import Raster, RasterKind

FloatArray = npt.NDArray[np.float64]
CAMERA_SIZE = (640, 480)
RASTER_SIZE = (912, 1140)
MEETING_POINT_MM = (0.0, 0.0, 500.0)
RIGHT_CENTRE_MM = (120.0, 0.0, 0.0)
PROJECTOR_CENTRE_MM = (60.0, -60.0, 0.0)
WORKING_RANGE_MM = (400.0, 670.0)
_PROJECTOR_SPAN_MM = 420.0
"""Width that the raster's columns cover at the meeting point's distance."""


def reference_rig(raster: RasterKind = "diamond", lens_shift: float = 0.0) -> Rig:
    """The rig of docs/rig.md; the simulator's default.

    lens_shift: how far the projector throws above its own axis, as a share of half its image height: 0 throws
    straight ahead, 1 keeps the axis at the image's lower edge. The image stays aimed at the same point.
    """
    width, height = RASTER_SIZE
    fx = width * MEETING_POINT_MM[2] / _PROJECTOR_SPAN_MM
    fy = 2 * fx if raster == "diamond" else fx
    middle = ((width - 1) / 2, (height - 1) / 2)
    principal = (middle[0], middle[1] + lens_shift * height / 2)
    aim = np.array([0.0, (middle[1] - principal[1]) / fy, 1.0])
    left = Device(
        CAMERA_SIZE, _matrix(1000, 1000, 321.3, 238.4), np.array([-0.1, 0.015, 2e-4, -1e-4, 0.0]), name="left"
    )
    right = placed(
        CAMERA_SIZE,
        _matrix(1000, 1000, 317.8, 241.9),
        np.array([-0.103, 0.018, -1e-4, 2e-4, 0.0]),
        RIGHT_CENTRE_MM,
        "right",
    )
    projector = placed(
        RASTER_SIZE,
        _matrix(fx, fy, *principal),
        np.array([-0.03, 0.0, 0.0, 0.0, 0.0]),
        PROJECTOR_CENTRE_MM,
        "projector",
        aim,
    )
    return Rig(
        left,
        right,
        projector,
        Raster(width, height, raster),
        {"source": "simulated rig, reference geometry", "working_range_mm": list(WORKING_RANGE_MM)},
    )


def _matrix(fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)


def placed(
    size: tuple[int, int],
    matrix: FloatArray,
    distortion: FloatArray,
    centre: tuple[float, float, float],
    name: str,
    aim: FloatArray | None = None,
    meeting_point: tuple[float, float, float] = MEETING_POINT_MM,
) -> Device:
    """A device without roll whose direction ``aim`` (in its own frame, x = 0; default its axis) meets the point."""
    forward = np.array(meeting_point) - np.array(centre)
    forward /= np.linalg.norm(forward)
    across = np.cross([0.0, 1.0, 0.0], forward)
    across /= np.linalg.norm(across)
    rotation = np.stack([across, np.cross(forward, across), forward])
    if aim is not None:
        pitch = np.arctan2(aim[1], aim[2])
        c, s = np.cos(pitch), np.sin(pitch)
        rotation = np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) @ rotation
    return Device(size, matrix, distortion, rotation, -rotation @ np.array(centre), name)
