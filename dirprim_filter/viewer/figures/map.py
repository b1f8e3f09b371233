"""The map, petals by speed, and closer where most happens."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import compress
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import SMALL, color_bar, dress_map, mark_close_up, new_figure
from dirprim_filter.viewer.layers import (
    CELL_GREY,
    FOCUS_COLOR,
    INK,
    OTHER_COLOR,
    TRACK_GREY,
    draw_estimates,
    draw_forecast,
    draw_frame,
    draw_map,
    draw_tracks,
)

Forecasts = Mapping[str, FloatArray]
"""Rollouts by track id, (n_samples, n_steps, 2) metres each."""

ONE_WIDTH, TWO_WIDTH, TALLEST = 7.9, 11.4, 9.0
"""Inches across a figure of one map and of two; and the height of one that is longer north to south."""
AROUND = (1.7, 1.1)
"""Inches beside and below the maps: numbers, colour bar, key."""
SHOWN_SHARE = 0.99
"""Of the traffic: a vehicle that is far away must not make all others small."""
LARGEST_CLOSE_UP = 0.6
"""A close-up spans no more than this share of the whole."""
KEY_WIDTH = 1.6
"""Inches, of an entry below the maps."""
FADED = 0.35
"""Opacity of the roses under vehicles."""
KEY: Mapping[str, dict[str, Any]] = {
    "cells": {"color": CELL_GREY, "linewidth": 0.8},
    "roots, where petals start": {"color": INK, "marker": "o", "markersize": 3, "linestyle": "none"},
    "tracks": {"color": TRACK_GREY, "linewidth": 0.5},
    "estimates, thin: coasting": {"color": OTHER_COLOR, "linewidth": 1.6},
    "forecast samples": {"color": FOCUS_COLOR, "linewidth": 0.7},
    "estimate, 90 % region": {"color": OTHER_COLOR, "marker": "o", "markersize": 4, "linewidth": 1.4},
    "detection": {"color": INK, "marker": "x", "markersize": 4, "linestyle": "none"},
    "true vehicle": {"color": INK, "linewidth": 0.9},
}


def map_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
    frame: TrackedFrame | None = None,
    truth: Tracks | None = None,
    extent: FloatArray | None = None,
    width: float | None = None,
) -> Figure:
    """The learned map: cells, and petals coloured by mean speed; a legend explains every kind of line.

    It shows where 99 % of the traffic is. Beside it stands, where it is much smaller, its busy part, or that of the
    forecasts.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines.
        forecasts: sampled rollouts.
        frame: vehicles at one instant; the roses fade.
        truth: where they truly were.
        extent: (2, 2) metres, the south-west and the north-east corner to show. Default: 99 % of the traffic.
        width: inches, of the figure.
    """
    boxes = [shapes.map_extent(primitives, share=SHOWN_SHARE) if extent is None else extent]
    near = shapes.busy_square(primitives)
    if forecasts:
        box = shapes.extent(np.concatenate([paths.reshape(-1, 2) for paths in forecasts.values()]))
        near = box.mean(axis=0) + 0.5 * np.ptp(box, axis=0).max() * np.array([[-1.0], [1.0]])
    if extent is None and np.ptp(near, axis=0).max() <= LARGEST_CLOSE_UP * np.ptp(boxes[0], axis=0).max():
        boxes.append(near)
    forecast = frozenset(forecasts or ())
    figure, panels = _page(boxes, width)
    for axes, box in zip(panels, boxes, strict=True):
        colors = draw_map(axes, primitives, opacity=1.0 if frame is None else FADED)
        if tracks is not None:
            draw_tracks(axes, tracks)
        if estimates is not None:
            draw_estimates(axes, estimates, forecast)
        for paths in (forecasts or {}).values():
            draw_forecast(axes, paths, FOCUS_COLOR, opacity=0.4)
        if frame is not None:
            draw_frame(axes, frame, truth, forecast)
        dress_map(axes, box)
    if len(panels) > 1:
        dress_map(panels[0], boxes[0], "(a)  Overview")
        dress_map(panels[1], boxes[1], "(b)  Closer")
        panels[1].set_ylabel("")
        mark_close_up(panels[0], boxes[1], "b")
    color_bar(figure, colors, panels, "mean speed [m/s]")
    has_truth = frame is not None and truth is not None
    shown = (
        True,
        True,
        tracks is not None,
        estimates is not None,
        bool(forecasts),
        *[frame is not None] * 2,
        has_truth,
    )
    lines = [Line2D([], [], label=name, **style) for name, style in compress(KEY.items(), shown)]
    n_rows = -(-len(lines) // max(int(figure.get_figwidth() / KEY_WIDTH), 2))
    columns = -(-len(lines) // n_rows)
    figure.legend(handles=lines, loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False)
    return figure


def _page(boxes: list[FloatArray], width: float | None) -> tuple[Figure, list[Axes]]:
    """Panels of one height, as wide as their boxes ask for."""
    shape = [float(east / north) for east, north in (np.ptp(box, axis=0) for box in boxes)]
    across = width or (ONE_WIDTH if len(boxes) == 1 else TWO_WIDTH)
    height = (across - AROUND[0]) / sum(shape) + AROUND[1]
    if width is None and height > TALLEST:
        across, height = (TALLEST - AROUND[1]) * sum(shape) + AROUND[0], TALLEST
    figure = new_figure(across, height)
    return figure, list(figure.subplots(1, len(boxes), width_ratios=shape, squeeze=False)[0])
