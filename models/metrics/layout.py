"""Rows of cells as plain text and as Markdown; the first row holds the headings, a row of one cell is a heading too."""

from __future__ import annotations

from collections.abc import Sequence

Rows = Sequence[Sequence[str]]


def text_table(rows: Rows) -> str:
    """Columns of plain text: the first to the left, numbers to the right, a line under the headings."""
    widths = [max(map(len, cells)) for cells in zip(*(row for row in rows if len(row) > 1), strict=True)]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        if len(row) > 1
        else row[0]
        for row in rows
    ]
    lines.insert(1, "-" * len(lines[0]))
    return "\n".join(lines)


def markdown_table(rows: Rows) -> str:
    """A table of GitHub's Markdown; rows of one cell are bold. Bars in cells are escaped."""
    columns = len(rows[0])
    lines = []
    for row in rows:
        cells = [cell.strip().replace("|", "\\|") for cell in row]
        lines.append([f"**{cells[0]}**", *[""] * (columns - 1)] if len(cells) == 1 else cells)
    lines.insert(1, ["---", *["---:"] * (columns - 1)])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
