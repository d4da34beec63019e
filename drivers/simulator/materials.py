"""What a surface does with light: albedo with a solid texture, and a specular lobe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from drivers.simulator.noise import fractal_noise

TextureKind = Literal["none", "marble", "spots", "stripes", "checks"]
TEXTURES: tuple[TextureKind, ...] = ("marble", "spots", "stripes", "checks")


@dataclass(frozen=True)
class Material:
    """Reflectance of one object.

    albedo: diffuse reflectance 0..1 of the lightest places. contrast: share of the albedo that the darkest places of
    the texture lack. scale_mm: size of the texture's features. seed: of the texture's pattern and direction.
    specular: normal-incidence weight of the normalised Blinn-Phong lobe, 0 for matt. shininess: its exponent.
    """

    albedo: float = 0.6
    texture: TextureKind = "none"
    contrast: float = 0.0
    scale_mm: float = 20.0
    seed: int = 0
    specular: float = 0.0
    shininess: float = 40.0

    def albedo_at(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Albedo, float32 (N,), at points (N, 3), mm; a texture is solid and fixed in space."""
        if self.texture == "none" or self.contrast == 0:
            return np.full(len(points), self.albedo, np.float32)
        rng = np.random.default_rng([self.seed, 7])
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        local = np.empty((len(points), 3))
        _turned(np.ascontiguousarray(points, np.float64), axes / self.scale_mm, rng.uniform(-20, 20, 3), local)
        return np.asarray(self.albedo * (1 - self.contrast * self._darkness(local)), np.float32)

    def _darkness(self, local: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        """0..1 at points in units of the feature size; edges are about a tenth of a feature wide."""
        if self.texture == "stripes":
            return _soft_step(np.sin(np.pi * local[:, 0]))
        if self.texture == "checks":
            return _soft_step(2 * np.sin(np.pi * local[:, 0]) * np.sin(np.pi * local[:, 1]))
        noise = fractal_noise(local, self.seed, octaves=3 if self.texture == "marble" else 2)
        if self.texture == "marble":
            return np.asarray(np.clip(0.5 + 1.6 * noise, 0, 1))
        return _soft_step(2.5 * noise)


def _soft_step(value: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    return np.asarray(np.clip(0.5 + 3.0 * value, 0, 1))


@compiled
def _turned(points: Any, axes: Any, origin: Any, out: Any) -> None:
    for i in range(len(points)):
        for k in range(3):
            out[i, k] = axes[k, 0] * points[i, 0] + axes[k, 1] * points[i, 1] + axes[k, 2] * points[i, 2] + origin[k]
