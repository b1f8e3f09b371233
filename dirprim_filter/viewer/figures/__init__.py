"""Figures for papers, talks and pages, one file for each kind; each function returns a matplotlib `Figure`.

Drawn through matplotlib's objects and never through pyplot: nothing global changes and no window opens.
"""

from matplotlib.figure import Figure as Figure

from dirprim_filter.viewer.figures.map import map_figure as map_figure
from dirprim_filter.viewer.figures.page import save_figure as save_figure
from dirprim_filter.viewer.figures.place import place_figure as place_figure
