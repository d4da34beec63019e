"""The paper's two tables, those of classes and of differences, as rows of text; figures as plain text and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from models.metrics.figures import Difference, Figures, Interval
from models.metrics.layout import text_table

Intervals = Mapping[str, Interval]
Differences = Mapping[str, Difference]


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
CLASS_TABLE = tuple(
    column
    for column in MAIN_TABLE
    if column.figure in ("valid", "order_accuracy", "mae_depth", "rmse_depth", "within_1mm")
)
"""The figures that are told for each class of scenes and each region."""


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
    """Both tables in plain text, with the numbers of samples and pixels under them."""
    blocks = [text_table(table_rows(columns, results, intervals)) for columns in TABLES]
    return "\n\n".join([*blocks, counts_line(results)]) + "\n"


def class_rows(classes: Mapping[str, Mapping[str, Figures]]) -> list[list[str]]:
    """Cells of the table of classes: for each class, by its title, a row of one cell and then a row a method."""
    rows = [["class, method", *(column.heading for column in CLASS_TABLE)]]
    for title, results in classes.items():
        first = next(iter(results.values()))
        rows.append([f"{title}: {_samples(first)}, {first.pixels} pixels"])
        rows += [
            [f"  {method}", *(_cell(getattr(figures, c.figure), c.decimals) for c in CLASS_TABLE)]
            for method, figures in results.items()
        ]
    return rows


def difference_rows(columns: Sequence[Column], differences: Mapping[str, Differences], against: str) -> list[list[str]]:
    """Cells of a table of differences to the row ``against``: signed, marked ``*`` where the interval excludes 0.

    Under each row stands its interval.
    """
    rows = [[f"minus {against}", *(column.heading for column in columns)]]
    for method, by_figure in differences.items():
        told = [(by_figure[column.figure], column.decimals) for column in columns]
        rows.append([method, *(_signed(d.value, n) + ("*" if d.excludes_zero else " ") for d, n in told)])
        bounds = [f"{_signed(d.low, n)}..{_signed(d.high, n)} " for d, n in told]
        rows.append(["  95 %", *(cell if cell != "-..- " else "- " for cell in bounds)])
    return rows


def counts_line(results: Mapping[str, Figures]) -> str:
    """The numbers of samples and pixels that figures are of."""
    if not results:
        return "no method was compared"
    first = next(iter(results.values()))
    return f"{_samples(first)}, {first.pixels} foreground pixels, {first.common_pixels} of them valid in every method"


def figures_as_json(figures: Figures, intervals: Intervals | None = None) -> dict[str, Any]:
    """Figures by name, null where one does not exist; intervals as {"name": [low, high]} under "intervals"."""
    plain: dict[str, Any] = {name: _number(value) for name, value in asdict(figures).items()}
    if intervals is not None:
        plain["intervals"] = {name: [_number(bound) for bound in pair] for name, pair in intervals.items()}
    return plain


def differences_as_json(differences: Differences) -> dict[str, Any]:
    """Difference, its interval and whether that excludes 0, by figure; null where one does not exist."""
    return {
        name: {
            "difference": _number(told.value),
            "interval": [_number(told.low), _number(told.high)],
            "excludes_zero": told.excludes_zero,
        }
        for name, told in differences.items()
    }


def _cell(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def _signed(value: float, decimals: int) -> str:
    return f"{value:+.{decimals}f}" if math.isfinite(value) else "-"


def _samples(figures: Figures) -> str:
    return "1 sample" if figures.samples == 1 else f"{figures.samples} samples"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
