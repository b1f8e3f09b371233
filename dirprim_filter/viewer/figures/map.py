"""The whole map: as petals by speed, roses by probability, arrows from cell to cell, and its cells over the data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.drawing import shapes
from dirprim_filter.estimates import Estimates
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import (
    DOTS_PER_INCH,
    LARGE,
    SMALL,
    add_axes,
    dress_color_bar,
    dress_map,
    mark_close_up,
)
from dirprim_filter.viewer.layers import (
    CELL_GREY,
    FOCUS_COLOR,
    INK,
    OTHER_COLOR,
    TRACK_GREY,
    draw_cells,
    draw_estimates,
    draw_flow,
    draw_forecast,
    draw_map,
    draw_roses,
    draw_rows,
    draw_tracks,
    draw_wheel,
)
from tessellation import OUTSIDE, Tessellation

Forecasts = Mapping[str, FloatArray]
"""Rollouts by track id, (n_samples, n_steps, 2) metres each."""

MAP_WIDTH = 6.5
"""Inches across a map; as tall as the map asks for."""
TALLEST, FLATTEST = 8.0, 2.0
"""Inches: a map that is longer north to south is narrower instead."""
BAR_WIDTH = 1.5
"""Inches beside a map, for its axis and its colour bar."""
NARROW = 4.5
"""Inches: below it a legend has two columns."""
PANELS_WIDTH = 9.6
"""Inches across two maps beside each other."""
LEFT, BOTTOM, GAP, KEY_WIDTH = 0.65, 0.5, 0.5, 0.8
"""Inches around maps beside each other."""
BUSY_SHARE = 0.6
"""A close-up holds this share of the traffic."""
CLOSE_UP_SHARE = 0.6
"""No close-up that spans more than this share of the whole."""
CELL_LINE = Line2D([], [], color=CELL_GREY, linewidth=0.8, label="cells")
TRACK_LINE = Line2D([], [], color=TRACK_GREY, linewidth=2.5, label="tracks")
ROOT_DOT = Line2D([], [], color=INK, marker="o", markersize=3, linestyle="none", label="roots, where petals start")


def map_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
    extent: FloatArray | None = None,
    width: float | None = None,
) -> Figure:
    """The learned map: cells, and petals coloured by mean speed; a legend explains every kind of line.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines.
        forecasts: sampled rollouts.
        extent: (2, 2) metres, the south-west and the north-east corner to show. Default: the whole map.
        width: inches, of the figure. Default: 8, less for a map that is longer north to south.
    """
    box = shapes.map_extent(primitives) if extent is None else extent
    span, depth = box[1] - box[0]
    if width is None:
        height = float(np.clip(MAP_WIDTH * depth / span, FLATTEST, TALLEST))
        across = max(FLATTEST, min(MAP_WIDTH, height * span / depth))
    else:
        across = width - BAR_WIDTH
        height = across * depth / span
    figure = Figure(figsize=(across + BAR_WIDTH, height + 0.85), dpi=DOTS_PER_INCH, layout="compressed")
    axes = figure.add_subplot()
    colors = draw_map(axes, primitives)
    if tracks is not None:
        draw_tracks(axes, tracks)
    if estimates is not None:
        draw_estimates(axes, estimates, {})
    for paths in (forecasts or {}).values():
        draw_forecast(axes, paths, FOCUS_COLOR, opacity=0.4)
    dress_map(axes, box)
    bar = figure.colorbar(colors, ax=axes, shrink=0.6, pad=0.02, extend="max")
    dress_color_bar(bar, "mean speed [m/s]")
    lines = [CELL_LINE, ROOT_DOT]
    lines += [TRACK_LINE] * (tracks is not None)
    lines += [Line2D([], [], color=OTHER_COLOR, linewidth=1.6, label="estimates")] * (estimates is not None)
    lines += [Line2D([], [], color=FOCUS_COLOR, linewidth=0.7, label="forecast samples")] * bool(forecasts)
    columns = len(lines) if across > NARROW else 2
    figure.legend(handles=lines, loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False)
    return figure


def rose_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    extent: FloatArray | None = None,
    width: float | None = None,
) -> Figure:
    """The paper's Fig. 9: a rose diagram in each cell, from blue to red by **probability**.

    A sector's area and its colour both show how probable it is that a vehicle there goes that way; `map_figure` shows
    how fast.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        extent: (2, 2) metres, as in `map_figure`.
        width: inches, of the figure.
    """
    sheet = Sheet.of(primitives.tessellation, primitives.n_rows[:-1], extent=extent, width=width)
    for axes in sheet.panels:
        colors = draw_roses(axes, primitives)
        if tracks is not None:
            draw_tracks(axes, tracks)
    left, bottom, _, height = sheet.key_box
    bar = sheet.figure.colorbar(colors, cax=add_axes(sheet.figure, (left, bottom + 0.2 * height, 0.15, 0.6 * height)))
    dress_color_bar(bar, f"probability of a {360 / shapes.N_SECTORS:g}° sector")
    sheet.explain_lines(has_tracks=tracks is not None)
    return sheet.figure


def transition_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    extent: FloatArray | None = None,
    width: float | None = None,
) -> Figure:
    """Transitions: arrows from cell to cell, as wide as the share of vehicles that left the first cell that way.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        extent: (2, 2) metres, as in `map_figure`.
        width: inches, of the figure.
    """
    sheet = Sheet.of(primitives.tessellation, primitives.n_rows[:-1], extent=extent, width=width)
    for axes in sheet.panels:
        outlines = shapes.cell_outlines(primitives.tessellation)
        axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.4, zorder=1))
        draw_flow(axes, primitives)
        if tracks is not None:
            draw_tracks(axes, tracks)
    left, bottom, width, height = sheet.key_box
    key = add_axes(sheet.figure, (left, bottom + 0.5 * height, width, width))
    draw_wheel(key, "direction of\nan arrow")
    key.text(0.0, -2.6, "width: share of\nvehicles leaving\nthe cell", ha="center", va="top", fontsize=SMALL)
    sheet.explain_lines(has_tracks=tracks is not None)
    return sheet.figure


def cell_figure(
    tessellation: Tessellation, tracks: Tracks, *, extent: FloatArray | None = None, width: float | None = None
) -> Figure:
    """The cells of any tessellation over the rows of tracks, coloured by direction.

    Args:
        tessellation: the cells.
        tracks: the rows; those at rest, whose direction means nothing, are grey.
        extent: (2, 2) metres, as in `map_figure`.
        width: inches, of the figure.
    """
    cell = tessellation.cell_of(tracks.position)
    n_rows = np.bincount(cell[cell != OUTSIDE], minlength=tessellation.n_cells)
    sheet = Sheet.of(tessellation, n_rows, extent=extent, width=width)
    for axes in sheet.panels:
        draw_rows(axes, tracks)
        draw_cells(axes, tessellation)
    left, bottom, width, height = sheet.key_box
    key = add_axes(sheet.figure, (left, bottom + 0.5 * height, width, width))
    draw_wheel(key, "direction of\na row's vehicle")
    counts = f"{tessellation.n_cells:,} cells\n{len(tracks):,} rows\n{tracks.n_tracks:,} vehicles"
    key.text(0.0, -2.6, counts, ha="center", va="top", fontsize=SMALL)
    return sheet.figure


class Sheet(NamedTuple):
    """The whole map and, where that is much smaller, its busy part; room for a key on the right.

    Attributes:
        figure: the figure.
        panels: (a) the whole, and (b) the busy part.
        key_box: left, bottom, width, height in inches.
    """

    figure: Figure
    panels: list[Axes]
    key_box: tuple[float, float, float, float]

    @classmethod
    def of(
        cls, tessellation: Tessellation, n_rows: IntArray, *, extent: FloatArray | None, width: float | None
    ) -> Self:
        """The sheet of a tessellation.

        Args:
            tessellation: the cells.
            n_rows: (n_cells,) rows in each.
            extent: (2, 2) metres to show, and then no close-up; None for all cells.
            width: inches, of the figure; None for what fits a page.
        """
        whole = shapes.cell_extent(tessellation) if extent is None else extent
        busy = shapes.busy_square(tessellation, n_rows, share=BUSY_SHARE)
        span, depth = whole[1] - whole[0]
        has_close_up = extent is None and (busy[1] - busy[0]).max() <= CLOSE_UP_SHARE * max(span, depth)
        room = PANELS_WIDTH if has_close_up else MAP_WIDTH
        if width is not None:
            room = width - LEFT - GAP * has_close_up - KEY_WIDTH - 0.4
        height = min(room / (span / depth + has_close_up), TALLEST)
        across = height * span / depth
        boxes = [(LEFT, BOTTOM, across, height)]
        if has_close_up:
            boxes.append((LEFT + across + GAP, BOTTOM, height, height))
        key = boxes[-1][0] + boxes[-1][2] + 0.25
        figure = Figure(figsize=(key + KEY_WIDTH + 0.15, BOTTOM + height + 0.35), dpi=DOTS_PER_INCH)
        panels = [add_axes(figure, inches) for inches in boxes]
        for axes, box in zip(panels, (whole, busy), strict=False):
            dress_map(axes, box)
        if len(panels) > 1:
            panels[1].set_ylabel("")
            panels[0].set_title("(a)  The whole", loc="left", fontsize=LARGE)
            panels[1].set_title("(b)  Where most happens", loc="left", fontsize=LARGE)
            mark_close_up(panels[0], panels[1], "b")
        return cls(figure, panels, (key, BOTTOM, KEY_WIDTH, height))

    def explain_lines(self, *, has_tracks: bool) -> None:
        """A legend of the thin lines, in the lower right corner."""
        lines = [CELL_LINE, *[TRACK_LINE] * has_tracks]
        self.figure.legend(handles=lines, loc="lower right", fontsize=SMALL, frameon=False, handlelength=1.2)
