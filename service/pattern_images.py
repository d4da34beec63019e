"""Pattern images for projectors that are loaded with files, one pattern each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from models.atomic import atomic_folder
from models.patterns import (
    LIGHTCRAFTER_4500,
    FringeParameters,
    Pattern,
    PatternPlan,
    PlanName,
    RasterKind,
    make_plan,
)
from models.png import write_png

SCHEMA = "pattern-images/1"


def combined_plan(names: Sequence[PlanName], parameters: FringeParameters | None = None) -> PatternPlan:
    """One plan with every pattern of the named ones, each once, in the order in which they first come."""
    patterns = {p.name: p for name in names for p in make_plan(name, parameters).patterns}
    return PatternPlan(name="+".join(dict.fromkeys(names)), patterns=tuple(patterns.values()))


def export_patterns(folder: Path, names: Sequence[PlanName], kind: RasterKind) -> dict[str, Any]:
    """Write ``<pattern>.png`` (8-bit, 912x1140) for each pattern, and ``manifest.json``, which is returned.

    The folder must not exist yet; it appears complete or not at all. Raises DuofringeError otherwise.
    """
    raster = replace(LIGHTCRAFTER_4500, kind=kind)
    chosen = combined_plan(names, FringeParameters(raster=raster))
    manifest = {
        "schema": SCHEMA,
        "plan": chosen.name,
        "raster": asdict(raster),
        "patterns": [{"file": f"{p.name}.png", **p.model_dump(mode="json")} for p in chosen.patterns],
    }
    with atomic_folder(folder) as partial:
        for pattern in chosen.patterns:
            write_png(partial / f"{pattern.name}.png", pattern.render(raster))
        (partial / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return manifest


def describe(pattern: Pattern) -> str:
    """Name and parameters of a pattern in one line."""
    facts = []
    if pattern.periods:
        facts.append("period " + " and ".join(f"{p:g}" for p in pattern.periods) + " columns")
    if pattern.is_row_coded:
        facts[-1] = facts[-1].replace("columns", "rows")
    if pattern.is_fringe:
        facts.append(f"step {pattern.step} of {pattern.steps}")
    if pattern.is_gray:
        facts.append(f"bit {pattern.bit} of {pattern.bits}")
    return f"{pattern.name:<15}{', '.join(facts)}".rstrip()
