"""How the viewer opens: the map from above with north up, curves of the filter's health, what to read first.

Two-dimensional views of rerun count y downwards, which would mirror the map; so this is a three-dimensional
view whose eye looks straight down.
"""

from collections.abc import Mapping

import numpy as np
import rerun.blueprint as rrb
from rerun.encodings import TimeRangeBoundary

from tessellation.arrays import FloatArray

TIMELINE = "message_log_time"
"""The log's own time, named as rerun's MCAP importer names it, so that a raw log can be opened beside it."""
TRAIL_S = 5.0
BACKGROUND = (16, 19, 26)
PLOTS: Mapping[str, str] = {
    "/metrics/ess": "Effective sample size (mean over vehicles)",
    "/metrics/log_evidence": "Log evidence (mean over vehicles)",
    "/metrics/vehicles": "Vehicles",
}
EYE_HEIGHT = 1.02
"""Height of the eye as a share of the depth of ground to be seen; the view's opening angle is fixed."""
VIEW_ASPECT = 1.15
"""The view's width over its height, when the window is of common shape."""


def blueprint(extent: FloatArray, *, live: bool) -> rrb.Blueprint:
    """The layout fitted to a map.

    Args:
        extent: (2, 2) metres, its south-west and north-east corner.
        live: keep the cursor at the newest frame; a file is played from its start instead.
    """
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=TimeRangeBoundary.cursor_relative(),
    )
    above = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", "- /metrics/**", "- /report", "- /legend"],
        name="Map, north up",
        background=rrb.Background(color=BACKGROUND),
        line_grid=False,
        eye_controls=_eye_above(extent),
        overrides={"/tracks/trails": trail},
    )
    plots = [
        rrb.TimeSeriesView(origin=path, name=name, plot_legend=rrb.PlotLegend(visible=False))
        for path, name in PLOTS.items()
    ]
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="/legend", name="What is what"),
        rrb.TextDocumentView(origin="/report", name="Run"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(above, rrb.Vertical(*plots, texts, row_shares=[2, 2, 2, 3]), column_shares=[7, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "playing"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _eye_above(extent: FloatArray) -> rrb.EyeControls3D:
    x, y = extent.mean(axis=0)
    width, depth = extent[1] - extent[0]
    height = EYE_HEIGHT * float(np.maximum(width / VIEW_ASPECT, depth))
    return rrb.EyeControls3D(position=(x, y, height), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0))
