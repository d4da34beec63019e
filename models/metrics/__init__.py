"""How right a point map is: the figures of the paper's two tables (section "Evaluation metrics")."""

from models.metrics.classes import CLASS_TITLES, REGION_TITLES, classes_of, traits_of
from models.metrics.edges import depth_edges, near_edges
from models.metrics.figures import Difference, Figures, Interval, aggregate, bootstrap, paired_bootstrap
from models.metrics.reference import Reference
from models.metrics.samples import SampleErrors, common_mask, compare, compare_all
from models.metrics.tables import differences_as_json, figures_as_json, table_rows, table_text

__all__ = [
    "CLASS_TITLES",
    "REGION_TITLES",
    "Difference",
    "Figures",
    "Interval",
    "Reference",
    "SampleErrors",
    "aggregate",
    "bootstrap",
    "classes_of",
    "common_mask",
    "compare",
    "compare_all",
    "depth_edges",
    "differences_as_json",
    "figures_as_json",
    "near_edges",
    "paired_bootstrap",
    "table_rows",
    "table_text",
    "traits_of",
]
