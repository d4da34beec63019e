"""The paper's two tables as rows of text, as plain text, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from models.metrics.figures import Figures, Interval

Intervals = Mapping[str, Interval]


@dataclass(frozen=True)
class Column:
    """One column: its heading, the field of ``Figures`` it shows, and its decimals."""

    heading: str
    figure: str
    decimals: int


MAIN_TABLE = (
    Column("Valid %", "valid", 2),
    Column("FOAcc %", "order_accuracy", 2),
    Column("literal %", "order_accuracy_literal", 2),
    Column("MAE_Φ rad", "mae_phase", 3),
    Column("RMSE_Φ rad", "rmse_phase", 3),
    Column("MAE_z mm", "mae_depth", 3),
    Column("RMSE_z mm", "rmse_depth", 3),
    Column("Acc 1mm %", "within_1mm", 2),
    Column("Acc 3mm %", "within_3mm", 2),
)
"""The paper's tab:quantitative_results, with the literal form of FOAcc beside the tolerant one."""
DEPTH_TABLE = (
    Column("common MAE_z mm", "common_mae_depth", 3),
    Column("common RMSE_z mm", "common_rmse_depth", 3),
    Column("P95 |e_z| mm", "p95_depth", 3),
    Column("median |e_z| mm", "median_depth", 3),
    Column("> 3 mm ‰", "gross", 1),
)
"""The paper's tab:additional_depth_analysis, with the median and the share of gross errors."""
TABLES = (MAIN_TABLE, DEPTH_TABLE)


def table_rows(
    columns: Sequence[Column], results: Mapping[str, Figures], intervals: Mapping[str, Intervals] | None = None
) -> list[list[str]]:
    """Cells of a table, headings first, one row a method and under it its intervals; '-' for what does not exist."""
    rows = [["method", *(column.heading for column in columns)]]
    for method, figures in results.items():
        rows.append([method, *(_cell(getattr(figures, c.figure), c.decimals) for c in columns)])
        if intervals is not None:
            bounds = [intervals[method][column.figure] for column in columns]
            cells = ["..".join(_cell(b, c.decimals) for b in pair) for c, pair in zip(columns, bounds, strict=True)]
            rows.append(["  95 %", *(cell if cell != "-..-" else "-" for cell in cells)])
    return rows


def table_text(results: Mapping[str, Figures], intervals: Mapping[str, Intervals] | None = None) -> str:
    """Both tables in plain text, with the numbers of samples and pixels under each."""
    blocks = []
    for columns in TABLES:
        rows = table_rows(columns, results, intervals)
        widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
        lines = [
            "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
            for row in rows
        ]
        lines.insert(1, "-" * len(lines[0]))
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, _counts(results)]) + "\n"


def figures_as_json(figures: Figures, intervals: Intervals | None = None) -> dict[str, Any]:
    """Figures by name, null where one does not exist; intervals as {"name": [low, high]} under "intervals"."""
    plain: dict[str, Any] = {name: _number(value) for name, value in asdict(figures).items()}
    if intervals is not None:
        plain["intervals"] = {name: [_number(bound) for bound in pair] for name, pair in intervals.items()}
    return plain


def _cell(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def _counts(results: Mapping[str, Figures]) -> str:
    if not results:
        return "no method was compared"
    first = next(iter(results.values()))
    samples = "1 sample" if first.samples == 1 else f"{first.samples} samples"
    return f"{samples}, {first.pixels} foreground pixels, {first.common_pixels} of them valid in every method"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
