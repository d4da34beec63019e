"""How right a point map is: the figures of the paper's two tables (section "Evaluation metrics")."""

from models.metrics.figures import Figures, Interval, aggregate, bootstrap
from models.metrics.reference import Reference
from models.metrics.samples import SampleErrors, common_mask, compare, compare_all
from models.metrics.tables import figures_as_json, table_rows, table_text

__all__ = [
    "Figures",
    "Interval",
    "Reference",
    "SampleErrors",
    "aggregate",
    "bootstrap",
    "common_mask",
    "compare",
    "compare_all",
    "figures_as_json",
    "table_rows",
    "table_text",
]
