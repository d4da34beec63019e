"""Simulated captures that several test files share, rendered once a session; nobody may write into them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from drivers.simulator.materials import Material
from drivers.simulator.mix import random_scene
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import cuboid
from models.capture import Capture, Image
from models.patterns import PatternKind, make_plan


@lru_cache(maxsize=1)
def simulated_rig() -> SimulatedRig:
    return SimulatedRig()


@lru_cache(maxsize=1)
def objects_before_wall() -> Capture:
    """Rounded objects and a cylinder before a wall, full plan."""
    return simulated_rig().render(random_scene(3, 2), make_plan("full"), (3, 2))


@lru_cache(maxsize=1)
def plate_before_wall() -> Capture:
    """A bright plate of 150 x 110 mm at 460 mm before a darker wall at 600 mm, full plan."""
    plate = SceneObject("plate", cuboid((150.0, 110.0, 2.0), (20.0, 10.0, 461.0)), Material(albedo=0.8))
    wall = SceneObject("wall", cuboid((900.0, 900.0, 2.0), (0.0, 0.0, 601.0)), Material(albedo=0.5))
    return simulated_rig().render(Scene((plate,), wall), make_plan("full"), 5)


def only(capture: Capture, kinds: Iterable[PatternKind]) -> Capture:
    """The capture with these pattern groups alone."""
    kept = frozenset(kinds)
    plan = capture.plan.restricted_to(p.name for p in capture.plan.patterns if p.kind in kept)
    images = {side: {name: capture.images[side][name] for name in plan.names} for side in capture.sides}
    return replace(capture, plan=plan, images=images)


def exposed(capture: Capture, gain: float, offset: float = 0.0) -> Capture:
    """The capture as a camera with another gain records it, clipped at full scale."""

    def adjust(image: Image) -> Image:
        return np.clip(np.rint(image * gain + offset), 0, capture.white_level).astype(image.dtype)

    images = {side: {name: adjust(image) for name, image in by.items()} for side, by in capture.images.items()}
    return replace(capture, images=images)
