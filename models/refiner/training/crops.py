"""Crops of prepared views, decided by seed, process and step alone, so that a training can go on where it stopped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from models.refiner.training.configuration import TrainingConfiguration
from models.refiner.training.views import View

_TRIES = 6
_LEAST_LIT = 0.25
"""Share of a crop that should carry fringes; a crop of the background teaches little."""


@dataclass(frozen=True, eq=False)
class Crops:
    """A batch. image, texture: float32 (B, 1, H, W). carriers: complex64 (B, 2, H, W). target: complex64 (B, 2, H, W),
    unit phasors of the labels, 0 where there is no phase, or None. known: bool (B, 1, H, W), where labels tell
    anything.
    """

    image: torch.Tensor
    texture: torch.Tensor
    carriers: torch.Tensor
    target: torch.Tensor | None
    known: torch.Tensor | None


def draw_crops(views: Sequence[View], configuration: TrainingConfiguration, step: int, process: int = 0) -> Crops:
    """The crops of one step. Views and places are drawn anew each time; half of them are turned upside down, half
    mirrored with their phases reversed, and all are brighter or darker by up to a third."""
    rng = np.random.default_rng([configuration.seed, process, step])
    height, width = configuration.crops[rng.integers(len(configuration.crops))]
    smallest = (min(view.size[0] for view in views), min(view.size[1] for view in views))
    width, height = min(width, smallest[0]), min(height, smallest[1])
    count = max(1, round(configuration.pixels / (height * width)))
    chosen = [views[i] for i in rng.integers(len(views), size=count)]
    return stacked([_crop(view, (height, width), configuration.losses.noise_level, rng) for view in chosen])


def whole_view(view: View) -> Crops:
    """A view as it is."""
    return stacked([_Crop.read(view, (slice(None), slice(None)))])


@dataclass(frozen=True, eq=False)
class _Crop:
    planes: np.ndarray[tuple[int, ...], np.dtype[np.float32]]
    phasors: np.ndarray[tuple[int, ...], np.dtype[np.complex64]] | None
    known: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None

    @classmethod
    def read(cls, view: View, place: tuple[slice, slice]) -> _Crop:
        planes = np.load(view.planes, mmap_mode="r")[:, place[0], place[1]].astype(np.float32)
        if view.columns is None:
            return cls(planes, None, None)
        column = np.array(np.load(view.columns, mmap_mode="r")[place], np.float32)
        told = np.isfinite(column)
        turns = np.where(told, column, 0.0)[None] / np.array(view.periods, np.float64)[:, None, None]
        phasors = np.where(told, np.exp(2j * np.pi * view.sign * turns), 0.0).astype(np.complex64)
        return cls(planes, phasors, ~np.isinf(column))

    def lit_share(self, noise: float) -> float:
        return float((np.hypot(self.planes[2], self.planes[3]) > noise).mean())

    def varied(self, rng: np.random.Generator) -> _Crop:
        planes, phasors, known = self.planes, self.phasors, self.known
        if rng.random() < 0.5:
            planes = planes[:, ::-1]
            phasors = None if phasors is None else phasors[..., ::-1, :]
            known = None if known is None else known[..., ::-1, :]
        if rng.random() < 0.5:
            # mirrored, the phases fall along x; their conjugates grow again
            planes = planes[:, :, ::-1] * np.array([1, 1, 1, -1, 1, -1], np.float32)[:, None, None]
            phasors = None if phasors is None else phasors[..., ::-1].conj()
            known = None if known is None else known[..., ::-1]
        gain = np.float32(rng.uniform(0.67, 1.33))
        return _Crop(planes * min(gain, np.float32(1 / max(float(planes[0].max()), 1e-3))), phasors, known)


def _crop(view: View, size: tuple[int, int], noise: float, rng: np.random.Generator) -> _Crop:
    best: _Crop | None = None
    share = -1.0
    for _ in range(_TRIES):
        top = int(rng.integers(view.size[1] - size[0] + 1))
        left = int(rng.integers(view.size[0] - size[1] + 1))
        crop = _Crop.read(view, (slice(top, top + size[0]), slice(left, left + size[1])))
        lit = crop.lit_share(4 * noise)
        if lit > share:
            best, share = crop, lit
        if share >= _LEAST_LIT:
            break
    assert best is not None
    return best.varied(rng)


def stacked(crops: Sequence[_Crop]) -> Crops:
    planes = torch.from_numpy(np.ascontiguousarray(np.stack([crop.planes for crop in crops])))
    pairs = planes[:, 2:].reshape(len(crops), 2, 2, *planes.shape[2:]).movedim(2, -1).contiguous()
    target = known = None
    phasors = [crop.phasors for crop in crops if crop.phasors is not None]
    certain = [crop.known for crop in crops if crop.known is not None]
    if len(phasors) == len(crops):
        target = torch.from_numpy(np.ascontiguousarray(np.stack(phasors)))
        known = torch.from_numpy(np.ascontiguousarray(np.stack(certain)))[:, None]
    return Crops(planes[:, 0:1].contiguous(), planes[:, 1:2].contiguous(), torch.view_as_complex(pairs), target, known)
