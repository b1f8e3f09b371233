"""Figures for papers, talks and pages, one file for each kind; each function returns a matplotlib `Figure`.

Drawn through matplotlib's objects and never through pyplot: nothing global changes and no window opens.
"""

from matplotlib.figure import Figure

from dirprim_filter.viewer.figures.blind import Way, blind_figure
from dirprim_filter.viewer.figures.demo import demo_figure
from dirprim_filter.viewer.figures.map import cell_figure, map_figure, rose_figure, transition_figure
from dirprim_filter.viewer.figures.page import check_figure_path, save_figure
from dirprim_filter.viewer.figures.primitive import direction_figure, speed_figure
from dirprim_filter.viewer.figures.product import product_figure, rejection_figure
from dirprim_filter.viewer.figures.table import cue_table_figure, density_table_figure

__all__ = [
    "Figure",
    "Way",
    "blind_figure",
    "cell_figure",
    "check_figure_path",
    "cue_table_figure",
    "demo_figure",
    "density_table_figure",
    "direction_figure",
    "map_figure",
    "product_figure",
    "rejection_figure",
    "rose_figure",
    "save_figure",
    "speed_figure",
    "transition_figure",
]
