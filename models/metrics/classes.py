"""Classes of scenes, and regions of images, by which figures are told apart."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from models.metrics.edges import BAND_PX

CLASS_TITLES: Mapping[str, str] = {
    "smooth": "smooth relief",
    "fine": "stairs and thin parts",
    "isolated": "isolated objects",
    "textured": "textured",
    "glossy": "glossy",
    "dark": "dark",
}
REGION_TITLES: Mapping[str, str] = {
    "boundaries": f"within {BAND_PX} px of a depth edge",
    "interior": "away from depth edges",
}
_DEMANDING = frozenset({"fine", "textured", "glossy", "dark"})


def classes_of(traits: Collection[str]) -> tuple[str, ...]:
    """The classes that a scene of these traits belongs to, in the order of the tables; a scene may be of several.

    "fine", "textured", "glossy" and "dark" are traits by themselves. "smooth" has none of them; "isolated" has no
    "wall" behind its objects.
    """
    found = {
        "smooth": not _DEMANDING & set(traits),
        "isolated": "wall" not in traits,
        **{trait: trait in traits for trait in _DEMANDING},
    }
    return tuple(name for name in CLASS_TITLES if found[name])


def traits_of(settings: dict[str, Any]) -> frozenset[str] | None:
    """Traits that a capture's ``settings.traits`` names; None where it names none, as recorded captures do not."""
    traits = settings.get("traits")
    if not isinstance(traits, list) or not all(isinstance(trait, str) for trait in traits):
        return None
    return frozenset(traits)
