"""Sequences as the audit gets them, and what can go wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from simulated_captures import simulated_rig

from drivers.simulator.materials import Material
from drivers.simulator.mix import random_scene
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.sensor import Sensor
from drivers.simulator.shapes import cuboid
from models.capture import Capture, Image
from models.geometry.rig import Side
from models.patterns import FringeParameters, PlanName, make_plan
from service.acquisition.audit import AuditReport, audit
from service.acquisition.finding import Finding

Images = Mapping[Side, Mapping[str, Image]]
BOTH: tuple[Side, ...] = ("left", "right")


def audited(capture: Capture, images: Images | None = None) -> AuditReport:
    return audit(capture.images if images is None else images, capture.plan, capture.white_level)


def fatal(report: AuditReport) -> list[Finding]:
    return [finding for finding in report.findings if finding.fatal]


def shown_instead(capture: Capture, places: Sequence[int], views: Sequence[Side] = BOTH) -> Images:
    """Images in which exposure k of ``views`` is the one that belongs at ``places[k]``."""
    names = capture.plan.names
    return {
        side: {name: by[names[places[k]] if side in views else name] for k, name in enumerate(names)}
        for side, by in capture.images.items()
    }


def exchanged(count: int, a: int, b: int) -> list[int]:
    places = list(range(count))
    places[a], places[b] = b, a
    return places


def replaced(capture: Capture, name: str, change: Mapping[Side, Image]) -> Images:
    """The images with one exposure of some views put in the place of the recorded one."""
    return {side: {**by, name: change[side]} if side in change else dict(by) for side, by in capture.images.items()}


@lru_cache(maxsize=4)
def simulated(plan: PlanName, seed: int, index: int, parameters: FringeParameters | None = None) -> Capture:
    return simulated_rig().render(random_scene(seed, index), make_plan(plan, parameters), (seed, index))


@lru_cache(maxsize=2)
def with_sensor(seed: int, index: int, sensor: Sensor, interreflection: bool = False) -> Capture:
    rig = SimulatedRig(sensor=sensor, interreflection=interreflection)
    return rig.render(random_scene(seed, index), make_plan("full"), (seed, index))


@lru_cache(maxsize=1)
def small_plate() -> Capture:
    """A dark plate of 40 x 40 mm before nothing: 2 % of the field is lit."""
    plate = SceneObject("plate", cuboid((40.0, 40.0, 2.0), (0.0, 0.0, 501.0)), Material(albedo=0.12))
    return simulated_rig().render(Scene((plate,)), make_plan("full"), 3)


def dark_frame(like: Image, level: int = 2) -> Image:
    """A frame without any light of the projector: black level and noise."""
    noise = np.random.default_rng(0).normal(level, 0.6, like.shape)
    return np.clip(np.rint(noise), 0, None).astype(like.dtype)
