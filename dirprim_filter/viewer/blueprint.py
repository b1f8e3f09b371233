"""How the viewer opens: the map from above with north up, curves of the filter's health, what to read first.

Two-dimensional views of rerun count y downwards, which would mirror the map; so this is a three-dimensional
view whose eye looks straight down.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb
from rerun.encodings import TimeRangeBoundary

from dirprim_filter.arrays import FloatArray
from dirprim_filter.viewer.curves import PLOTS
from dirprim_filter.viewer.stream import TIMELINE

TRAIL_S = 5.0
BACKGROUND = (16, 19, 26)
LAYERS = (
    "/map/**", "/detections/**", "/truth/**", "/tracks/**", "/smoothed/**", "/forecasts/**", "/focus/ring",
)  # fmt: skip
"""Entities of the map view: each can be switched off by its path."""
TRAILS = ("/tracks/trails", "/smoothed/trails", "/truth/trails")
EYE_HEIGHT = 1.02
"""Height of the eye as a share of the depth of ground to be seen; the view's opening angle is fixed."""
VIEW_ASPECT = {1: 1.35, 2: 1.2}
"""A map view's width over its height, by the number of runs, when the window is of common shape."""
POLAR_EXTENT = 1.45


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """What the viewer's window shows.

    Attributes:
        box: (2, 2) metres, south-west and north-east corner of what is looked at.
        live: keep the cursor at the newest frame; a file is played from its start instead.
        roots: the path under which each run stands; one run stands at the top.
        titles: of each run's map.
        tracked: there are frames, or will be; a map alone needs no plots.
    """

    box: FloatArray
    live: bool = False
    roots: tuple[str, ...] = ("",)
    titles: tuple[str, ...] = ("Map, north up",)
    tracked: bool = True

    def blueprint(self) -> rrb.Blueprint:
        """The layout as the viewer takes it."""
        maps: list[rrb.View | rrb.Container] = [
            self._above(root, title) for root, title in zip(self.roots, self.titles, strict=True)
        ]
        above: rrb.View | rrb.Container = maps[0] if len(maps) == 1 else rrb.Horizontal(*maps)
        if not self.tracked:
            side: rrb.View | rrb.Container = self._texts()
            whole: rrb.Container = rrb.Horizontal(above, side, column_shares=[7, 2])
        elif len(self.roots) == 1:
            left = rrb.Vertical(above, self._lanes(), row_shares=[5, 1])
            top = rrb.Horizontal(self._polar(), self._texts(), column_shares=[1, 1.25])
            right = rrb.Vertical(top, *self._plots(), row_shares=[2.4, 1.5, 1.5, 1.2, 1.2])
            whole = rrb.Horizontal(left, right, column_shares=[6, 4])
        else:
            below = rrb.Horizontal(*self._plots(), self._texts(), column_shares=[3, 3, 3, 3, 2])
            whole = rrb.Vertical(above, below, row_shares=[7, 3])
        return rrb.Blueprint(
            whole,
            rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if self.live else "playing"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.BlueprintPanel(state="collapsed"),
            auto_views=False,
            auto_layout=False,
        )

    def _above(self, root: str, title: str) -> rrb.View:
        trail = rrb.VisibleTimeRanges(
            timeline=TIMELINE,
            start=TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=TimeRangeBoundary.cursor_relative(),
        )
        return rrb.Spatial3DView(
            origin=root or "/",
            contents=[f"+ {root}{layer}" for layer in LAYERS],
            name=title,
            background=rrb.Background(color=BACKGROUND),
            line_grid=False,
            eye_controls=eye_above(self.box, aspect=VIEW_ASPECT[len(self.roots)]),
            overrides={root + path: trail for path in TRAILS},
        )

    def _polar(self) -> rrb.View:
        reach = (-POLAR_EXTENT, POLAR_EXTENT)
        return rrb.Spatial2DView(
            origin="/polar",
            name="Direction of the ringed vehicle (Eq. 4)",
            background=rrb.Background(color=BACKGROUND),
            visual_bounds=rrb.VisualBounds2D(x_range=reach, y_range=reach),
        )

    def _lanes(self) -> rrb.View:
        return rrb.StateTimelineView(origin="/vehicles", name="Vehicles: grey coasting, yellow reinitialised")

    def _plots(self) -> Sequence[rrb.View | rrb.Container]:
        speed, consistency, innovation, evidence, ess, existence = (self._plot(path) for path in PLOTS)
        return [speed, rrb.Tabs(consistency, innovation), rrb.Tabs(ess, evidence), existence]

    def _plot(self, path: str) -> rrb.View:
        return rrb.TimeSeriesView(
            origin=self.roots[0] + path,
            contents=[f"+ {root}{path}" for root in self.roots],
            name=PLOTS[path].title if len(self.roots) == 1 else PLOTS[path].title.split(":")[0],
            plot_legend=rrb.PlotLegend(visible=False),
            axis_y=rrb.ScalarAxis(range=PLOTS[path].range) if PLOTS[path].range else None,
        )

    def _texts(self) -> rrb.Container:
        root = self.roots[0]
        views: list[rrb.View | rrb.Container] = [
            rrb.TextDocumentView(origin=f"{root}/legend", name="Legend"),
            *(
                rrb.TextDocumentView(origin=f"{root}/report", name=f"Run{title}")
                for root, title in zip(self.roots, self._suffixes(), strict=True)
            ),
        ]
        if self.tracked:
            views += [
                rrb.TextLogView(origin=f"{root}/events", name=f"Events{title}")
                for root, title in zip(self.roots, self._suffixes(), strict=True)
            ]
        return rrb.Tabs(*views)

    def _suffixes(self) -> list[str]:
        return [""] if len(self.roots) == 1 else [f" {title}" for title in self.titles]


def eye_above(box: FloatArray, *, aspect: float) -> rrb.EyeControls3D:
    """An eye that looks straight down on a box, (2, 2) metres, in a view so wide over its height."""
    x, y = box.mean(axis=0)
    width, depth = box[1] - box[0]
    height = EYE_HEIGHT * float(np.maximum(width / aspect, depth))
    return rrb.EyeControls3D(position=(x, y, height), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0))
