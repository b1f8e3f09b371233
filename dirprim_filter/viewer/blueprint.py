"""How the viewer opens: the map from above with north up, curves of the filter's health, what to read first.

Two-dimensional views of rerun count y downwards, which would mirror the map; so this is a three-dimensional
view whose eye looks straight down.
"""

import numpy as np
import rerun.blueprint as rrb
from rerun.encodings import TimeRangeBoundary

from dirprim_filter.arrays import FloatArray
from dirprim_filter.viewer.curves import PLOTS
from dirprim_filter.viewer.stream import TIMELINE

TRAIL_S = 5.0
BACKGROUND = rrb.Background(color=(16, 19, 26))
LAYERS = (
    "/map/**", "/detections/**", "/truth/**", "/tracks/**", "/smoothed/**", "/forecasts/**", "/focus/ring",
)  # fmt: skip
"""Entities of the map view: each can be switched off by its path."""
TRAILS = ("/tracks/trails", "/smoothed/trails", "/truth/trails")
EYE_HEIGHT = 1.02
"""Height of the eye as a share of the depth of ground to be seen; the view's opening angle is fixed."""
VIEW_ASPECT = 1.15
"""The map view's width over its height, when the window is of common shape."""
POLAR_EXTENT = (-1.45, 1.45)


def blueprint(box: FloatArray, *, live: bool, tracked: bool) -> rrb.Blueprint:
    """What the viewer's window shows.

    Args:
        box: (2, 2) metres, south-west and north-east corner of what is looked at.
        live: keep the cursor at the newest frame; a file is played from its start instead.
        tracked: there are frames, or will be; a map alone needs no plots.
    """
    legend = rrb.TextDocumentView(origin="/legend", name="Legend")
    if tracked:
        panel = rrb.Spatial2DView(
            origin="/polar", name="Direction of the ringed vehicle (Eq. 4)", background=BACKGROUND,
            visual_bounds=rrb.VisualBounds2D(x_range=POLAR_EXTENT, y_range=POLAR_EXTENT),
        )  # fmt: skip
        read = rrb.Tabs(legend, rrb.TextLogView(origin="/events", name="Events"))
        top = rrb.Horizontal(panel, read, column_shares=[1, 1.25])
        right = rrb.Vertical(top, *map(_plot, PLOTS), row_shares=[2.4, 1.5, 1.2, 1.5])
        whole = rrb.Horizontal(_above(box), right, column_shares=[6, 4])
    else:
        whole = rrb.Horizontal(_above(box), legend, column_shares=[7, 2])
    return rrb.Blueprint(
        whole,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "playing"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _above(box: FloatArray) -> rrb.View:
    """An eye that looks straight down on the box."""
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=TimeRangeBoundary.cursor_relative(),
    )
    x, y = box.mean(axis=0)
    width, depth = box[1] - box[0]
    height = EYE_HEIGHT * float(np.maximum(width / VIEW_ASPECT, depth))
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"+ {layer}" for layer in LAYERS],
        name="Map, north up",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=(x, y, height), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0)),
        overrides=dict.fromkeys(TRAILS, trail),
    )


def _plot(path: str) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=path,
        name=PLOTS[path].title,
        plot_legend=rrb.PlotLegend(visible=False),
        axis_y=rrb.ScalarAxis(range=PLOTS[path].range) if PLOTS[path].range else None,
    )
