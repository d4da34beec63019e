"""Ray casting: one Embree scene over all objects, and what a ray finds there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from drivers.simulator.compiled import compiled
from drivers.simulator.meshes import Mesh

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

SURFACE_OFFSET_MM = 0.05
"""How far secondary rays start above the facet they leave, so that it does not shadow itself."""


@dataclass(frozen=True, eq=False)
class Hits:
    """First surfaces along N rays.

    hit: bool (N,). points: float64 (N, 3), mm, undefined where nothing is hit, as are the rest. normals: float32
    (N, 3), interpolated between vertices; facets: float32 (N, 3), of the triangle itself; both unit length and turned
    towards the ray's origin. objects: int16 (N,), index of the mesh, -1 where nothing is hit.
    """

    hit: BoolArray
    points: FloatArray
    normals: Float32Array
    facets: Float32Array
    objects: npt.NDArray[np.int16]

    def lifted_at(self, index: npt.NDArray[np.intp]) -> FloatArray:
        """Some of the points moved off their facets, where rays to a light or camera start."""
        return np.asarray(self.points[index] + SURFACE_OFFSET_MM * self.facets[index], np.float64)


class Tracer:
    """Casts rays against a fixed set of meshes. Calls release the GIL and may come from several threads."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self._empty = not meshes
        if self._empty:
            return
        whole = Mesh.join(meshes)
        self._faces = whole.faces
        self._vertices = np.ascontiguousarray(whole.vertices, np.float32)
        self._normals = np.ascontiguousarray(whole.normals, np.float32)
        self._object = np.repeat(np.arange(len(meshes), dtype=np.int16), [len(m.faces) for m in meshes])
        self._scene = EmbreeScene()
        self._geometry = TriangleMesh(self._scene, self._vertices, self._faces)
        # the first query builds the tree and must not race with another
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), query="OCCLUDED")

    def cast(self, origin: npt.NDArray[np.floating], directions: npt.NDArray[np.floating]) -> Hits:
        """First hits of rays from ``origin`` (3,) or (N, 3) along ``directions`` (N, 3), of any length."""
        count = len(directions)
        origins = np.broadcast_to(np.asarray(origin, np.float64), (count, 3))
        hits = Hits(
            np.zeros(count, np.bool_),
            np.zeros((count, 3)),
            np.zeros((count, 3), np.float32),
            np.zeros((count, 3), np.float32),
            np.full(count, -1, np.int16),
        )
        if self._empty or not count:
            return hits
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32), output=1
        )
        _surfaces(
            origins,
            np.ascontiguousarray(directions, np.float64),
            found["tfar"],
            found["primID"],
            found["u"],
            found["v"],
            found["Ng"],
            self._faces,
            self._normals,
            self._object,
            hits.hit,
            hits.points,
            hits.normals,
            hits.facets,
            hits.objects,
        )
        return hits

    def sees(self, points: npt.NDArray[np.floating], target: npt.NDArray[np.floating]) -> BoolArray:
        """Whether nothing stands between points (N, 3) and the target (3,), mm; lift points off their surface first."""
        if self._empty or not len(points):
            return np.ones(len(points), np.bool_)
        towards = np.ascontiguousarray(np.asarray(target) - points, np.float32)
        reach = np.ones(len(points), np.float32)
        blocker = self._scene.run(np.ascontiguousarray(points, np.float32), towards, reach, query="OCCLUDED")
        return np.asarray(blocker < 0)


@compiled
def _surfaces(
    origins: Any,
    directions: Any,
    distance: Any,
    triangle: Any,
    first: Any,
    second: Any,
    across: Any,
    faces: Any,
    vertex_normals: Any,
    face_object: Any,
    hit: Any,
    points: Any,
    normals: Any,
    facets: Any,
    objects: Any,
) -> None:
    for i in range(len(triangle)):
        face = triangle[i]
        if face < 0:
            continue
        hit[i] = True
        objects[i] = face_object[face]
        b, c = first[i], second[i]
        a = 1.0 - b - c
        facet_length = 0.0
        normal_length = 0.0
        facing = 0.0
        for k in range(3):
            points[i, k] = origins[i, k] + distance[i] * directions[i, k]
            n = (
                a * vertex_normals[faces[face, 0], k]
                + b * vertex_normals[faces[face, 1], k]
                + c * vertex_normals[faces[face, 2], k]
            )
            normals[i, k] = n
            normal_length += n * n
            facets[i, k] = across[i, k]
            facet_length += across[i, k] * across[i, k]
            facing += across[i, k] * directions[i, k]
        facet_scale = 1.0 / max(np.sqrt(facet_length), 1e-30)
        if facing > 0:
            facet_scale = -facet_scale
        agreement = 0.0
        for k in range(3):
            facets[i, k] *= facet_scale
            agreement += facets[i, k] * normals[i, k]
        normal_scale = 1.0 / max(np.sqrt(normal_length), 1e-30)
        if agreement < 0:
            normal_scale = -normal_scale
        for k in range(3):
            normals[i, k] *= normal_scale
