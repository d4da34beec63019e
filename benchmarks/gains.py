"""What one row of an evaluation gains over the best transform, column by column, as Markdown.

Takes JSON files that ``duofringe evaluate ... --output`` wrote: ``python -m benchmarks.gains FILE.json [OTHER.json]``.
Transforms and the N-step pair come from the first file, the row from the last.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TRANSFORMS = ("wft", "wavelet1d", "wavelet2d", "shearlet")
SHARES = {"valid": "Valid %", "order_accuracy": "FOAcc %", "within_1mm": "Acc 1mm %", "within_3mm": "Acc 3mm %"}
ERRORS = {
    "mae_phase": "MAE_Φ rad",
    "rmse_phase": "RMSE_Φ rad",
    "mae_depth": "MAE_z mm",
    "rmse_depth": "RMSE_z mm",
    "p95_depth": "P95 mm",
    "median_depth": "median mm",
}
COMMON = {"common_mae_depth": "common MAE_z mm", "common_rmse_depth": "common RMSE_z mm"}
"""Over the pixels that all rows of one file have; rows of two files cannot be compared by them."""
Rows = Mapping[str, Mapping[str, float]]


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.gains", description=__doc__)
    arguments.add_argument("files", type=Path, nargs="+", metavar="FILE.json")
    arguments.add_argument("--row", default="refiner", help="method of the row (default refiner)")
    options = arguments.parse_args()
    read: list[dict[str, Any]] = [json.loads(path.read_text(encoding="utf-8")) for path in options.files]
    for matching in ("trinocular", "stereo"):
        base, own = read[0]["rows"], read[-1]["rows"][f"{options.row} {matching}"]
        print(f"**{matching.capitalize()}**\n\n{table(base, own, options.row, matching, common=len(read) == 1)}")


def table(base: Rows, own: Mapping[str, float], name: str, matching: str, *, common: bool) -> str:
    """base: rows of the transforms and of the N-step pair. own: figures of the row ``name``."""
    lines = [f"| figure | best transform | `{name}` | N-step pair | gain |", "|---|---:|---:|---:|---|"]
    pair = base[f"nstep wrapped {matching}"]
    for figure, heading in SHARES.items():
        best = max(base[f"{transform} {matching}"][figure] for transform in TRANSFORMS)
        gain = own[figure] - best
        told = f"{gain:+.1f} points, {100 * gain / (pair[figure] - best):.0f} % of the distance to the N-step pair"
        lines.append(f"| {heading} | {best:.2f} | {own[figure]:.2f} | {pair[figure]:.2f} | {told} |")
    for figure, heading in {**ERRORS, **(COMMON if common else {})}.items():
        best = min(base[f"{transform} {matching}"][figure] for transform in TRANSFORMS)
        told = f"x {own[figure] / best:.2f}"
        lines.append(f"| {heading} | {best:.3f} | {own[figure]:.3f} | {pair[figure]:.3f} | {told} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
