"""How the viewer opens: the map from above with north up, curves of the filter's health, and what to read first.

Two-dimensional views of rerun count y downwards, which would mirror the map; so this is a three-dimensional
view whose eye looks straight down.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.encodings import TimeRangeBoundary

from dirprim_filter.arrays import FloatArray
from dirprim_filter.viewer.curves import PLOTS
from dirprim_filter.viewer.process import ELAPSED

LAYERS = (
    "/map/**", "/detections/**", "/assigned", "/truth/**", "/tracks/**", "/smoothed/**", "/particles", "/forecasts/**",
    "/events/marks",
)  # fmt: skip
"""Entities of the map view: each can be switched off by its path."""

ROSES = """\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their share of those
that move; its colour is their mean speed, from violet (0 m/s) by green ({half:g} m/s) to yellow ({fastest:g} m/s and
more). A violet disc: the share of those that stand.

"""
LEGEND = """\
**White outlines**: true vehicles, where known. **Small dots**: detections, a colour for each sensor; arrows lead
there from where the track that they were assigned to was expected: innovations.

**Large dots, arrows, ellipses, trails**: estimates, where they will be in one second, the region that holds the
vehicle with 90 % probability, the last five seconds. Dark: coasting. With `--smooth`, bold: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Red**: an exchange of ids, a vehicle that is lost, a ghost; the tab *Events* says when.

**Particles**: some of each vehicle, with `--set particles_out=N`. By direction: amber east, green north, blue west,
magenta south.

A click selects a vehicle; the panel on the left hides it, or whole layers. The first {most} vehicles have an entity
and curves each, those after share one.
"""


def blueprint(box: FloatArray, *, live: bool, tracked: bool, with_truth: bool, on_earth: bool) -> rrb.Blueprint:
    """What the viewer's window shows.

    Args:
        box: (2, 2) metres, south-west and north-east corner of what is looked at.
        live: keep the cursor at the newest frame; a file is played from its start instead.
        tracked: there are frames, or will be; a map alone needs no plots.
        with_truth: there are true vehicles, and so errors.
        on_earth: it is known where the plane lies on the Earth.
    """
    legend = rrb.TextDocumentView(origin="/legend", name="Legend")
    (x, y), (width, depth) = box.mean(axis=0), box[1] - box[0]
    height = 1.02 * float(np.maximum(width / 1.15, depth))  # the eye's angle is fixed; views are of this shape
    eye = rrb.EyeControls3D(position=(x, y, height), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0))
    above: rrb.View | rrb.Container = rrb.Spatial3DView(
        origin="/", contents=[f"+ {layer}" for layer in LAYERS], name="Map, north up", line_grid=False,
        background=rrb.Background(color=(16, 19, 26)), eye_controls=eye,
    )  # fmt: skip
    if on_earth:
        earth = rrb.MapView(origin="/", contents=["+ /map/earth", "+ /truth/**", "+ /tracks/**"], name="On the Earth")
        above = rrb.Vertical(above, earth, row_shares=[2, 1])
    if tracked:
        events = rrb.TextLogView(origin="/events", name="Events")
        read = rrb.Tabs(*((events, legend) if with_truth else (legend, events)))
        plots = [_plots(*pair, with_truth=with_truth) for pair in list(pairwise(PLOTS))[::2]]
        right = rrb.Vertical(read, *plots)
        whole = rrb.Horizontal(above, right, column_shares=[6, 4])
    else:
        whole = rrb.Horizontal(above, legend, column_shares=[7, 2])
    time = rrb.TimePanel(state="collapsed", timeline=ELAPSED, play_state="following" if live else "playing")
    panels = rrb.SelectionPanel(state="collapsed"), rrb.BlueprintPanel(state="collapsed")
    return rrb.Blueprint(whole, time, *panels, auto_views=False, auto_layout=False)


def _plots(*paths: str, with_truth: bool) -> rrb.View | rrb.Container:
    """Plots that share a place, from the log's beginning to its end; those of the truth only with one."""
    whole_log = rr.TimeRange(start=TimeRangeBoundary.infinite(), end=TimeRangeBoundary.infinite())
    views = [
        rrb.TimeSeriesView(
            origin=path,
            name=PLOTS[path].title,
            plot_legend=rrb.PlotLegend(corner="LeftTop"),
            axis_x=rrb.TimeAxis(view_range=whole_log),
            axis_y=rrb.ScalarAxis(range=PLOTS[path].range) if PLOTS[path].range else None,
        )
        for path in paths
        if with_truth or not PLOTS[path].of_truth
    ]
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def legend(fastest: float | None, *, most: int) -> str:
    """Markdown; `fastest`: speed of a map's last colour, m/s; `most`: how many vehicles have an entity each."""
    roses = "" if fastest is None else ROSES.format(half=0.6 * fastest, fastest=fastest)
    return roses + LEGEND.format(most=most)
