"""How the projector's light and the ambient light reach each camera sub-sample.

Computed once per scene and camera; after it, an exposure to any pattern is a table look-up and a sum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.simulator.bounce import Bounce
from drivers.simulator.lamp import Irradiance, Lamp
from drivers.simulator.optics import Profile, footprint_offsets, gather
from drivers.simulator.projected import Picture
from drivers.simulator.raycast import Hits
from drivers.simulator.scene import Scene
from models.geometry.device import Device

Float32Array = npt.NDArray[np.float32]
Map = Callable[[Callable[[slice], None], Iterable[slice]], Iterable[None]]
AMBIENT_EDGE_ON = 0.6
"""Ambient light on a surface seen edge-on, as a share of that on one facing the camera."""
_ROWS_AT_ONCE = 40


@dataclass(frozen=True, eq=False)
class Footprints:
    """Lines of sight of one camera: directions float32 (H, W, S, 3), S sub-samples a pixel, left frame."""

    camera: Device
    directions: Float32Array

    @classmethod
    def of(cls, camera: Device, footprint: int) -> Footprints:
        """Exact inverse of the lens distortion for footprint x footprint sub-samples of every pixel."""
        pixels = camera.pixel_grid()[:, :, None, :] + footprint_offsets(footprint)
        return cls(camera, camera.rays(pixels).astype(np.float32))


@dataclass(frozen=True, eq=False)
class ViewLight:
    """What one camera sees of the projector's light.

    gain: float32 (H, W, S), light (1 = white level) that full white gives each of S sub-samples of a pixel.
    columns, rows: float32 (H, W, S), projector coordinates (u, v) there, undefined where gain is 0.
    ambient, albedo: float32 (H, W), light without the projector and mean albedo. objects: int16 (H, W), which object
    the first sub-sample shows, -1 for none. bounce: indirect light, None where it is not simulated.
    """

    gain: Float32Array
    columns: Float32Array
    rows: Float32Array
    ambient: Float32Array
    albedo: Float32Array
    objects: npt.NDArray[np.int16]
    bounce: Bounce | None = None

    @property
    def white(self) -> Float32Array:
        """Light (H, W) of full white alone, before the lens's blur."""
        return np.asarray(self.gain.mean(axis=2), np.float32)

    def under(self, projected: Profile | Picture) -> Float32Array:
        """Light (H, W) on the sensor under one pattern, before the lens's blur, ambient light included."""
        if isinstance(projected, Picture):
            profile, light = projected.profile, self._under_picture(projected)
        else:
            profile = projected
            light = gather(self.gain, self.rows if profile.row_coded else self.columns, profile, self.ambient)
        if self.bounce is not None:
            light += self.albedo * self.bounce.under(profile)
        return light

    def _under_picture(self, picture: Picture) -> Float32Array:
        light = self.ambient.copy()
        samples = self.gain.shape[2]
        for s in range(samples):
            lit = self.gain[..., s] > 0
            share = picture.at(*(np.where(lit, place[..., s], -1) for place in (self.columns, self.rows)))
            light += np.where(lit, self.gain[..., s] * share, 0) / np.float32(samples)
        return light


def view_light(scene: Scene, sight: Footprints, lamp: Lamp, ambient_scale: float, run: Map) -> ViewLight:
    """Cast every sub-sample of a camera into a scene. ``run`` maps a function over bands of rows, perhaps threaded."""
    height, width, samples, _ = sight.directions.shape
    tracer, eye = scene.tracer, sight.camera.centre
    gain = np.empty((height, width, samples), np.float32)
    columns, rows = np.empty_like(gain), np.empty_like(gain)
    ambient, albedo = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    objects = np.empty((height, width), np.int16)

    def band(part: slice) -> None:
        shape = gain[part].shape
        directions = sight.directions[part].reshape(-1, 3)
        hits = tracer.cast(eye, directions)
        falling = lamp.falling_on(hits, tracer)
        reflectance = scene.albedo_at(hits)
        light = reflectance / np.float32(np.pi) * falling.strength
        _add_highlights(light, scene, hits, falling, lamp, eye)
        gain[part] = light.reshape(shape)
        columns[part] = falling.mirrors[:, 0].reshape(shape)
        rows[part] = falling.mirrors[:, 1].reshape(shape)
        facing = np.abs(np.einsum("ij,ij->i", hits.normals, directions)) / np.linalg.norm(directions, axis=1)
        around = AMBIENT_EDGE_ON + (1 - AMBIENT_EDGE_ON) * facing
        ambient[part] = (ambient_scale * reflectance * around).reshape(shape).mean(axis=2)
        albedo[part] = reflectance.reshape(shape).mean(axis=2)
        objects[part] = hits.objects.reshape(shape)[..., 0]

    bands = [slice(start, start + _ROWS_AT_ONCE) for start in range(0, height, _ROWS_AT_ONCE)]
    for _ in run(band, bands):
        pass
    return ViewLight(gain, columns, rows, ambient, albedo, objects)


def _add_highlights(
    light: Float32Array, scene: Scene, hits: Hits, falling: Irradiance, lamp: Lamp, eye: npt.NDArray[np.float64]
) -> None:
    """The specular lobe: Blinn-Phong, normalised to reflect ``specular`` of the light at normal incidence."""
    for index, surface in enumerate(scene.surfaces):
        material = surface.material
        if material.specular <= 0:
            continue
        here = np.flatnonzero((hits.objects == index) & falling.lit)
        points, normals = hits.points[here], hits.normals[here]
        halfway = _unit(lamp.device.centre - points) + _unit(eye - points)
        cosine = np.clip(np.einsum("ij,ij->i", _unit(halfway), normals), 0, 1)
        lobe = (material.shininess + 8) / (8 * np.pi) * cosine**material.shininess
        light[here] += (material.specular * lobe).astype(np.float32) * falling.strength[here]


def _unit(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
