"""The map, and closer where most happens: petals by speed, or arrows from cell to cell."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import compress
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dirprim_filter.arrays import FloatArray
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
    draw_estimates,
    draw_flow,
    draw_forecast,
    draw_map,
    draw_tracks,
    draw_wheel,
)

Forecasts = Mapping[str, FloatArray]
"""Rollouts by track id, (n_samples, n_steps, 2) metres each."""

MAP_WIDTH, PANELS_WIDTH, TALLEST = 6.5, 9.6, 8.0
"""Inches across a map and across two; and the height of a map that is longer north to south, which is narrower."""
LEFT, BOTTOM, GAP, KEY_WIDTH = 0.42, 0.8, 0.28, 0.8
"""Inches around maps, without the numbers beside them."""
DIGIT = 0.065
"""Inches across a digit of these."""
SHOWN_SHARE = 0.99
"""Of the traffic: a vehicle that is far away must not make all others small."""
BUSY_SHARE = 0.6
"""A close-up holds this share of the traffic."""
CLOSE_UP_SHARE = 0.6
"""No close-up that spans more than this share of the whole."""
KEY: Mapping[str, dict[str, Any]] = {
    "cells": {"color": CELL_GREY, "linewidth": 0.8},
    "roots, where petals start": {"color": INK, "marker": "o", "markersize": 3, "linestyle": "none"},
    "tracks": {"color": TRACK_GREY, "linewidth": 0.5},
    "estimates, thin: coasting": {"color": OTHER_COLOR, "linewidth": 1.6},
    "forecast samples": {"color": FOCUS_COLOR, "linewidth": 0.7},
}


def map_figure(
    primitives: PrimitiveMap,
    *,
    transitions: bool = False,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
    extent: FloatArray | None = None,
    width: float | None = None,
) -> Figure:
    """The learned map: cells, and petals coloured by mean speed; a legend explains every kind of line.

    It shows where 99 % of the traffic is. Beside it stands, where it is much smaller, its busy part, or that of the
    forecasts.

    Args:
        primitives: the map.
        transitions: instead of petals arrows from cell to cell, as wide as the share of vehicles that left that way.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines.
        forecasts: sampled rollouts.
        extent: (2, 2) metres, the south-west and the north-east corner to show. Default: 99 % of the traffic.
        width: inches, of the figure.
    """
    whole = shapes.map_extent(primitives, share=SHOWN_SHARE) if extent is None else extent
    near = shapes.busy_square(primitives, share=BUSY_SHARE)
    if forecasts:
        box = shapes.extent(np.concatenate([paths.reshape(-1, 2) for paths in forecasts.values()]))
        near = box.mean(axis=0) + 0.5 * np.ptp(box, axis=0).max() * np.array([[-1.0], [1.0]])
    span, depth = whole[1] - whole[0]
    has_close_up = extent is None and (near[1] - near[0]).max() <= CLOSE_UP_SHARE * max(span, depth)
    digits = DIGIT * max(len(f"{north:.0f}") for north in whole[:, 1])
    room = PANELS_WIDTH if has_close_up else MAP_WIDTH
    if width is not None:
        room = width - LEFT - digits - (GAP + digits) * has_close_up - KEY_WIDTH - 0.4
    height = min(room / (span / depth + has_close_up), TALLEST)
    panels = [(LEFT + digits, height * span / depth, whole)]
    if has_close_up:
        panels.append((panels[0][0] + panels[0][1] + GAP + digits, height, near))
    key = panels[-1][0] + panels[-1][1] + 0.25
    figure = Figure(figsize=(key + KEY_WIDTH + 0.15, BOTTOM + height + 0.35), dpi=DOTS_PER_INCH)
    drawn = []
    for left, across, box in panels:
        axes = add_axes(figure, (left, BOTTOM, across, height))
        drawn.append(axes)
        if transitions:
            outlines = shapes.cell_outlines(primitives.tessellation)
            axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.4, zorder=1))
            draw_flow(axes, primitives)
        else:
            colors = draw_map(axes, primitives)
        if tracks is not None:
            draw_tracks(axes, tracks)
        if estimates is not None:
            draw_estimates(axes, estimates, {})
        for paths in (forecasts or {}).values():
            draw_forecast(axes, paths, FOCUS_COLOR, opacity=0.4)
        dress_map(axes, box)
    if has_close_up:
        whole_axes, close_up = drawn
        close_up.set_ylabel("")
        whole_axes.set_title("(a)  Overview", loc="left", fontsize=LARGE)
        close_up.set_title("(b)  Closer", loc="left", fontsize=LARGE)
        mark_close_up(whole_axes, close_up, "b")
    if transitions:
        wheel = add_axes(figure, (key, BOTTOM + 0.5 * height, KEY_WIDTH, KEY_WIDTH))
        draw_wheel(wheel, "direction of\nan arrow")
        wheel.text(0.0, -2.6, "width: share of\nvehicles leaving\nthe cell", ha="center", va="top", fontsize=SMALL)
    else:
        bar = add_axes(figure, (key, BOTTOM + 0.2 * height, 0.15, 0.6 * height))
        dress_color_bar(figure.colorbar(colors, cax=bar, extend="max"), "mean speed [m/s]")
    shown = (True, not transitions, tracks is not None, estimates is not None, bool(forecasts))
    lines = [Line2D([], [], label=name, **style) for name, style in compress(KEY.items(), shown)]
    columns = len(lines) if figure.get_figwidth() > 1.6 * len(lines) else 2
    figure.legend(handles=lines, loc="lower center", ncols=columns, fontsize=SMALL, frameon=False)
    return figure
