"""The whole map: as petals by speed, roses by probability, arrows from cell to cell, and its cells over the data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

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
from tessellation.arrays import FloatArray, IntArray

Forecasts = Mapping[str, FloatArray]
"""Sampled futures by track id, (n_samples, n_steps, 2) metres each."""

MAP_WIDTH = 6.5
"""Inches across a map; as tall as the map asks for."""
TALLEST, FLATTEST = 8.0, 2.0
"""Inches: a map that is longer north to south is narrower instead."""
PANELS_WIDTH = 9.6
"""Inches across two maps beside each other."""
LEFT, BOTTOM, GAP, KEY_WIDTH = 0.65, 0.5, 0.5, 0.8
"""Inches around maps beside each other."""
BUSY_SHARE = 0.6
"""A close-up holds this share of the traffic."""
CLOSE_UP_SHARE = 0.6
"""No close-up that spans more than this share of the whole."""


def map_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
) -> Figure:
    """The learned map: cells, and petals coloured by mean speed.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines.
        forecasts: sampled futures.
    """
    box = shapes.map_extent(primitives)
    width, depth = box[1] - box[0]
    height = float(np.clip(MAP_WIDTH * depth / width, FLATTEST, TALLEST))
    across = max(FLATTEST, min(MAP_WIDTH, height * width / depth))
    figure = Figure(figsize=(across + 1.5, height + 0.6), dpi=DOTS_PER_INCH, layout="compressed")
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
    return figure


def rose_figure(primitives: PrimitiveMap, *, tracks: Tracks | None = None) -> Figure:
    """The paper's Fig. 9: a rose diagram in each cell, from blue to red by **probability**.

    A sector's area and its colour both say how probable it is that a vehicle there goes that way; `map_figure` tells
    how fast.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
    """
    sheet = Sheet.of(primitives.tessellation, primitives.n_rows[:-1])
    for axes in sheet.panels:
        colors = draw_roses(axes, primitives)
        if tracks is not None:
            draw_tracks(axes, tracks)
    left, bottom, _, height = sheet.key_box
    bar = sheet.figure.colorbar(colors, cax=add_axes(sheet.figure, (left, bottom + 0.2 * height, 0.15, 0.6 * height)))
    dress_color_bar(bar, f"probability of a {360 / shapes.N_SECTORS:g}° sector")
    return sheet.figure


def transition_figure(primitives: PrimitiveMap, *, tracks: Tracks | None = None) -> Figure:
    """Where vehicles went on: arrows from cell to cell, as wide as the share of those who left the first for another.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
    """
    sheet = Sheet.of(primitives.tessellation, primitives.n_rows[:-1])
    for axes in sheet.panels:
        outlines = shapes.cell_outlines(primitives.tessellation)
        axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.4, zorder=1))
        draw_flow(axes, primitives)
        if tracks is not None:
            draw_tracks(axes, tracks)
    left, bottom, width, height = sheet.key_box
    key = add_axes(sheet.figure, (left, bottom + 0.5 * height, width, width))
    draw_wheel(key, "direction of\nan arrow")
    told = "width: share of\nthose who leave\na cell for another"
    key.text(0.0, -2.6, told, ha="center", va="top", fontsize=SMALL)
    return sheet.figure


def cell_figure(tessellation: Tessellation, tracks: Tracks) -> Figure:
    """The cells of any tessellation over the rows that vehicles left, coloured by direction.

    Args:
        tessellation: the cells.
        tracks: the rows; those at rest, whose direction means nothing, are grey.
    """
    cell = tessellation.cell_of(tracks.position)
    sheet = Sheet.of(tessellation, np.bincount(cell[cell != OUTSIDE], minlength=tessellation.n_cells))
    for axes in sheet.panels:
        draw_rows(axes, tracks)
        draw_cells(axes, tessellation)
    left, bottom, width, height = sheet.key_box
    key = add_axes(sheet.figure, (left, bottom + 0.5 * height, width, width))
    draw_wheel(key, "direction of\na row's vehicle")
    told = f"{tessellation.n_cells:,} cells\n{len(tracks):,} rows\n{tracks.n_tracks:,} vehicles"
    key.text(0.0, -2.6, told, ha="center", va="top", fontsize=SMALL)
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
    def of(cls, tessellation: Tessellation, n_rows: IntArray) -> Self:
        """The sheet of a tessellation whose cells hold so many rows, (n_cells,)."""
        whole = shapes.cell_extent(tessellation)
        busy = shapes.busy_square(tessellation, n_rows, share=BUSY_SHARE)
        width, depth = whole[1] - whole[0]
        has_close_up = (busy[1] - busy[0]).max() <= CLOSE_UP_SHARE * max(width, depth)
        room = PANELS_WIDTH if has_close_up else MAP_WIDTH
        height = min(room / (width / depth + has_close_up), TALLEST)
        across = height * width / depth
        boxes = [(LEFT, BOTTOM, across, height)]
        if has_close_up:
            boxes.append((LEFT + across + GAP, BOTTOM, height, height))
        key = boxes[-1][0] + boxes[-1][2] + 0.25
        figure = Figure(figsize=(key + KEY_WIDTH + 0.15, BOTTOM + height + 0.35), dpi=DOTS_PER_INCH)
        panels = [add_axes(figure, box) for box in boxes]
        for axes, extent in zip(panels, (whole, busy), strict=False):
            dress_map(axes, extent)
        if len(panels) > 1:
            panels[1].set_ylabel("")
            panels[0].set_title("(a)  The whole", loc="left", fontsize=LARGE)
            panels[1].set_title("(b)  Where most happens", loc="left", fontsize=LARGE)
            mark_close_up(panels[0], panels[1], "b")
        return cls(figure, panels, (key, BOTTOM, KEY_WIDTH, height))
