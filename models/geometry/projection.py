"""OpenCV's projection model as compiled scalar code, for kernels that project one candidate at a time."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from models.geometry.device import Device

FloatArray = npt.NDArray[np.float64]


def pack_projection(device: Device) -> FloatArray:
    """All of a device's projection in one float64 vector: pose (12), matrix (5), distortion (12), sensor tilt (9)."""
    distortion = np.zeros(14)
    distortion[: device.distortion.size] = device.distortion
    m = device.matrix
    intrinsics = [m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2]]
    tilt = _tilt(distortion[12], distortion[13])
    return np.concatenate([device.rotation.ravel(), device.translation, intrinsics, distortion[:12], tilt.ravel()])


def _tilt(tau_x: float, tau_y: float) -> FloatArray:
    """Matrix of OpenCV's tilted sensor model (the identity without tilt)."""
    cx, sx, cy, sy = math.cos(tau_x), math.sin(tau_x), math.cos(tau_y), math.sin(tau_y)
    rotation = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    corner = np.array([[rotation[2, 2], 0, -rotation[0, 2]], [0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1]])
    return np.asarray(corner @ rotation, np.float64)


@numba.njit(cache=True, fastmath=False, inline="always")
def project_point(q, x, y, z):  # type: ignore[no-untyped-def]
    """Pixel (u, v) of a left-frame point in mm; q from ``pack_projection``. The caller checks that z' > 0."""
    lx = q[0] * x + q[1] * y + q[2] * z + q[9]
    ly = q[3] * x + q[4] * y + q[5] * z + q[10]
    lz = q[6] * x + q[7] * y + q[8] * z + q[11]
    a = lx / lz
    b = ly / lz
    r2 = a * a + b * b
    r4 = r2 * r2
    r6 = r4 * r2
    k1, k2, p1, p2, k3 = q[17], q[18], q[19], q[20], q[21]
    radial = (1 + k1 * r2 + k2 * r4 + k3 * r6) / (1 + q[22] * r2 + q[23] * r4 + q[24] * r6)
    xd = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a) + q[25] * r2 + q[26] * r4
    yd = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b + q[27] * r2 + q[28] * r4
    tz = q[35] * xd + q[36] * yd + q[37]
    tx = (q[29] * xd + q[30] * yd + q[31]) / tz
    ty = (q[32] * xd + q[33] * yd + q[34]) / tz
    return q[12] * tx + q[13] * ty + q[14], q[15] * ty + q[16]


@numba.njit(cache=True, parallel=True)
def project_points(q, points):  # type: ignore[no-untyped-def]
    """Pixels (N, 2) of left-frame points (N, 3), float64; NaN for points not in front of the device."""
    pixels = np.full((len(points), 2), np.nan)
    for i in numba.prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if q[6] * x + q[7] * y + q[8] * z + q[11] > 1e-9:
            pixels[i, 0], pixels[i, 1] = project_point(q, x, y, z)
    return pixels
