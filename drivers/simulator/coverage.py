"""How much of a camera's field some meshes cover, by drawing their silhouettes on a coarse grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from drivers.simulator.meshes import Mesh
from drivers.simulator.optics import project_points
from models.geometry.device import Device

CELL_PX = 4


def silhouette(mesh: Mesh, camera: Device) -> npt.NDArray[np.bool_]:
    """Cells of 4 x 4 pixels, bool (ceil(H / 4), ceil(W / 4)), whose centre a mesh in front of the camera covers."""
    shape = (-(-camera.height // CELL_PX), -(-camera.width // CELL_PX))
    mask = np.zeros(shape, np.bool_)
    _draw((project_points(camera, mesh.vertices) + 0.5) / CELL_PX - 0.5, mesh.faces, mask)
    return mask


@compiled
def _draw(pixels: Any, faces: Any, mask: Any) -> None:
    height, width = mask.shape
    for f in range(len(faces)):
        ax, ay = pixels[faces[f, 0], 0], pixels[faces[f, 0], 1]
        bx, by = pixels[faces[f, 1], 0], pixels[faces[f, 1], 1]
        cx, cy = pixels[faces[f, 2], 0], pixels[faces[f, 2], 1]
        if not np.isfinite(ax + bx + cx):
            continue
        for y in range(max(0, int(np.ceil(min(ay, by, cy)))), min(height - 1, int(np.floor(max(ay, by, cy)))) + 1):
            for x in range(max(0, int(np.ceil(min(ax, bx, cx)))), min(width - 1, int(np.floor(max(ax, bx, cx)))) + 1):
                e0 = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                e1 = (cx - bx) * (y - by) - (cy - by) * (x - bx)
                e2 = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
                if (e0 >= 0 and e1 >= 0 and e2 >= 0) or (e0 <= 0 and e1 <= 0 and e2 <= 0):
                    mask[y, x] = True
