"""The default mix of scenes: which traits fall on which sample, and scenes that have them."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

from drivers.simulator.geometry import reference_rig
from drivers.simulator.materials import TEXTURES, Material
from drivers.simulator.meshes import FloatArray, Mesh
from drivers.simulator.placement import Volume, arrange
from drivers.simulator.scene import Scene, SceneObject
from drivers.simulator.shapes import FACED, FINE, SHAPES, cuboid
from models.geometry.rig import Rig

_SLOTS: tuple[frozenset[str], ...] = tuple(
    frozenset(traits.split())
    for traits in (
        "dark",
        "dark glossy wall",
        "textured",
        "textured fine wall",
        "textured wall",
        "glossy",
        "glossy fine",
        "fine wall",
        "fine",
        "wall",
        "wall",
        "",
    )
)
"""Traits of twelve scenes: 2 dark, 3 textured, 3 glossy, 4 with stairs or thin parts, 6 with a wall."""
LEAST_COVER = 0.42
"""Share of the field that objects cover when a scene is arranged: some of it will be shadowed or seen by one camera."""
DARK_ALBEDO = (0.07, 0.17)
_USUAL_ALBEDO = (0.35, 0.8)
_ONE_SCENE_STREAM, _TRAITS_STREAM = 11, 12


def traits_of(seed: int, index: int) -> frozenset[str]:
    """Traits of a sample. Any twelve samples in a row have each slot of the mix once, in an order set by the seed."""
    order = np.random.default_rng([seed, _TRAITS_STREAM]).permutation(len(_SLOTS))
    return _SLOTS[int(order[index % len(_SLOTS)])]


@lru_cache(maxsize=1)
def _reference() -> Rig:
    return reference_rig()


def random_scene(seed: int, index: int, rig: Rig | None = None) -> Scene:
    """Scene ``index`` of the endless series ``seed``; depends on nothing else.

    rig: whose left camera's field and working depths are to be filled; the reference rig by default.
    """
    rig = rig or _reference()
    rng = np.random.default_rng([seed, index, _ONE_SCENE_STREAM])
    traits = traits_of(seed, index)
    near, far = rig.working_depths
    wall, objects_far = _wall(rng, rig, far) if "wall" in traits else (None, far)
    volume = Volume(rig.left, near, objects_far)

    def draw(number: int) -> tuple[str, Mesh]:
        name = _shape_name(rng, fine="fine" in traits and number == 0)
        return name, SHAPES[name](rng).moved(rotation=_orientation(rng, name))

    placed = arrange(rng, volume, draw, least=int(rng.integers(1, 4)), cover=LEAST_COVER)
    objects = tuple(
        SceneObject(f"{name}-{_identity(seed, index, number)}", mesh, object_material(rng, traits, mesh))
        for number, (name, mesh) in enumerate(placed)
    )
    return Scene(objects, wall, traits)


def mesh_scene(seed: int, index: int, unit: Mesh, name: str, rig: Rig | None = None) -> Scene:
    """Scene ``index`` of the series ``seed`` around one given object, turned and placed anew in each.

    unit: the object inside the unit sphere; it is scaled to span most of the field. name: its identity.
    """
    rig = rig or _reference()
    rng = np.random.default_rng([seed, index, _ONE_SCENE_STREAM])
    traits = traits_of(seed, index) - {"fine"}
    near, far = rig.working_depths
    wall, objects_far = _wall(rng, rig, far) if "wall" in traits else (None, far)
    volume = Volume(rig.left, near, objects_far)
    radius = volume.width_at((near + far) / 2) * rng.uniform(0.34, 0.4)
    pixel = np.array(rig.left.size) * rng.uniform(0.45, 0.55, 2)
    mesh = volume.fit(unit.moved(rotation=random_rotation(rng)), radius, pixel, rng.uniform(0.2, 0.8))
    return Scene((SceneObject(name, mesh, object_material(rng, traits, mesh)),), wall, traits)


def _identity(seed: int, index: int, number: int) -> str:
    return hashlib.sha256(f"{seed}/{index}/{number}".encode()).hexdigest()[:6]


def _shape_name(rng: np.random.Generator, *, fine: bool) -> str:
    if fine:
        return str(rng.choice(["stairs", "stairs", "terraces", "comb", "grille"]))
    usual = [name for name in SHAPES if name not in FINE]
    weights = np.array([3.0 if name == "blob" else 0.5 if name == "plane" else 1.0 for name in usual])
    return str(rng.choice(usual, p=weights / weights.sum()))


def _orientation(rng: np.random.Generator, name: str) -> FloatArray:
    """Any turn for round shapes; shapes with a face keep it more or less towards the cameras."""
    if name in ("stairs", "terraces"):
        pitch = rng.uniform(0.35, 0.95) if name == "stairs" else rng.uniform(-0.4, 0.4)
        return rotation(rng.uniform(-0.6, 0.6), pitch, rng.uniform(-0.3, 0.3))
    if name in FINE:
        return rotation(rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.6))
    if name in FACED:
        return rotation(rng.uniform(-0.65, 0.65), rng.uniform(-0.6, 0.6), rng.uniform(-np.pi, np.pi))
    return random_rotation(rng)


def rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    """Rotation (3, 3) by roll about z, then pitch about x, then yaw about y, radians.

    A positive pitch tips the top of an object (towards -y) to the viewer, so that its upper side is seen.
    """
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    return np.asarray(about_y @ about_x @ about_z)


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """Uniform over all rotations (K. Shoemake, Graphics Gems III, 1992, from a random unit quaternion)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def object_material(rng: np.random.Generator, traits: frozenset[str], mesh: Mesh) -> Material:
    """A material with the asked traits, no brighter than the fixed exposure bears at the object's distance."""
    nearest = float(mesh.vertices[:, 2].min())
    albedo = rng.uniform(*DARK_ALBEDO) if "dark" in traits else rng.uniform(*_USUAL_ALBEDO)
    albedo = min(albedo, 0.8 * (nearest / 500.0) ** 2)
    glossy, textured = "glossy" in traits, "textured" in traits
    specular = rng.uniform(0.02, 0.06) if glossy else 0.0
    shininess = rng.uniform(25, 110)
    seed = int(rng.integers(2**31))
    texture, scale, contrast = TEXTURES[rng.integers(len(TEXTURES))], rng.uniform(9, 32), rng.uniform(0.6, 0.88)
    if not textured:
        # many matt things are not quite uniform
        texture, scale, contrast = "marble", rng.uniform(25, 80), max(0.0, rng.uniform(-0.2, 0.25))
    return Material(albedo, texture, contrast, scale, seed, specular, shininess)


def _wall(rng: np.random.Generator, rig: Rig, far: float) -> tuple[SceneObject, float]:
    """A wall near the end of the working range, sometimes beyond it, and the depth that it leaves to objects."""
    inside = rng.random() < 0.7
    depth = far * (rng.uniform(0.9, 0.945) if inside else rng.uniform(1.05, 1.25))
    yaw, pitch = rng.uniform(-0.08, 0.08, 2)
    reach = 0.5 * rig.left.width / rig.left.fx * depth
    size = 6 * reach
    turned = cuboid((size, size, 2.0)).moved(rotation=rotation(yaw, pitch, 0.0), translation=(0, 0, depth))
    material = Material(
        rng.uniform(0.3, 0.75),
        "marble",
        max(0.0, rng.uniform(-0.3, 0.4)),
        rng.uniform(30, 90),
        int(rng.integers(2**31)),
    )
    nearest_in_view = depth - reach * (abs(yaw) + abs(pitch)) - 5.0
    return SceneObject("wall", turned, material), min(far, nearest_in_view)
