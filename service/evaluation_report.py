"""An evaluation as tables for people: plain text for the terminal, Markdown for documents."""

from __future__ import annotations

from models.metrics.figures import Figures
from models.metrics.layout import Rows, markdown_table, text_table
from models.metrics.tables import TABLES, class_rows, counts_line, difference_rows, table_rows
from service.evaluation import TITLES, Evaluation

_LEGEND = "* marks a difference whose 95 % interval excludes 0; the same scenes are drawn for both rows."


def report_text(evaluation: Evaluation) -> str:
    """The paper's two tables, those of classes and differences where there are any, and the seconds a sample takes."""
    whole = "\n\n".join([*map(text_table, _whole_tables(evaluation)), counts_line(evaluation.whole.figures)])
    blocks = [whole]
    if evaluation.classes:
        blocks.append(text_table(_class_table(evaluation)))
    if evaluation.whole.differences:
        blocks.append("\n\n".join([*map(text_table, _difference_tables(evaluation)), _LEGEND]))
    return "\n\n".join(blocks) + "\n\n" + "\n".join(_timings(evaluation))


def report_markdown(evaluation: Evaluation, command: str) -> str:
    """The same as Markdown, under a heading, with the command that measures it again."""
    settings = evaluation.settings
    samples = len(evaluation.samples)
    blocks = [
        f"# Evaluation of {', '.join(settings['methods'])}",
        f"```\n{command}\n```",
        f"Dataset `{settings['dataset']}`, split `{settings['split']}`, {samples} sample{'s' if samples != 1 else ''}. "
        "What the columns mean stands in `docs/evaluation.md`.",
        "## Whole split",
        *map(markdown_table, _whole_tables(evaluation)),
        counts_line(evaluation.whole.figures) + ".",
    ]
    if evaluation.classes:
        blocks += ["## By class and region", markdown_table(_class_table(evaluation))]
    if evaluation.whole.differences:
        blocks += [f"## Differences to `{evaluation.against}`", *map(markdown_table, _difference_tables(evaluation))]
        blocks.append(_LEGEND.replace("*", "\\*"))
    timings = _timings(evaluation)
    if timings:
        blocks += ["## Time", "\n".join(f"- {line}" for line in timings)]
    return "\n\n".join(blocks) + "\n"


def _whole_tables(evaluation: Evaluation) -> list[Rows]:
    intervals = evaluation.whole.intervals if len(evaluation.samples) > 1 else None
    return [table_rows(columns, evaluation.whole.figures, intervals) for columns in TABLES]


def _class_table(evaluation: Evaluation) -> Rows:
    titled: dict[str, dict[str, Figures]] = {
        TITLES[name]: dict(summary.figures) for name, summary in evaluation.classes.items()
    }
    return class_rows(titled)


def _difference_tables(evaluation: Evaluation) -> list[Rows]:
    assert evaluation.against is not None
    return [difference_rows(columns, evaluation.whole.differences, evaluation.against) for columns in TABLES]


def _timings(evaluation: Evaluation) -> list[str]:
    return [
        f"{row}: {sum(stages.values()):.2f} s a sample ("
        + ", ".join(f"{name} {seconds:.2f}" for name, seconds in stages.items())
        + ")"
        for row, stages in evaluation.mean_timings_s().items()
        if stages
    ]
