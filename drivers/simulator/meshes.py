"""Triangle meshes with vertex normals: the only surface that the simulator knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int32]


def vertex_normals(vertices: FloatArray, faces: IndexArray) -> FloatArray:
    """Area-weighted unit normals (V, 3) of a mesh; sharp edges need their vertices doubled."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = faces.ravel()
    total = np.stack(
        [np.bincount(flat, np.repeat(across[:, axis], 3), minlength=len(vertices)) for axis in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.maximum(length, 1e-30), np.float64)


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices (V, 3) float64; faces (F, 3) int32; normals (V, 3) float64, unit length, interpolated over a face."""

    vertices: FloatArray
    faces: IndexArray
    normals: FloatArray

    @classmethod
    def smooth(cls, vertices: FloatArray, faces: IndexArray) -> Mesh:
        """A mesh without sharp edges."""
        return cls(vertices, faces, vertex_normals(vertices, faces))

    @classmethod
    def join(cls, parts: Sequence[Mesh]) -> Mesh:
        """All parts as one mesh; edges between parts stay sharp."""
        starts = np.cumsum([0, *(len(p.vertices) for p in parts[:-1])])
        return cls(
            np.concatenate([p.vertices for p in parts]),
            np.concatenate([p.faces + np.int32(s) for p, s in zip(parts, starts, strict=True)]).astype(np.int32),
            np.concatenate([p.normals for p in parts]),
        )

    def moved(
        self, scale: float = 1.0, rotation: FloatArray | None = None, translation: npt.ArrayLike = (0, 0, 0)
    ) -> Mesh:
        """Scaled, then rotated, then shifted."""
        turn = np.eye(3) if rotation is None else rotation
        return Mesh(
            scale * self.vertices @ turn.T + np.asarray(translation, np.float64), self.faces, self.normals @ turn.T
        )

    def unit(self) -> Mesh:
        """Centred on its bounding box and scaled into the unit sphere."""
        centred = self.vertices - (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return Mesh(centred / np.linalg.norm(centred, axis=1).max(), self.faces, self.normals)
