"""What figures are made of: one function for each layer that is drawn on a pair of axes, from the map up.

Sizes that mean something are in metres, so that they hold at every scale; line widths are in points.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color, speed_color
from dirprim_filter.drawing.sight import may_be_anywhere
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

CONFIDENCE = 0.9
MAX_GAP_S = 2.0
"""A vehicle unseen for longer is drawn as two lines."""
ROOT_DIAMETER = 0.12
"""Of the dot at a rose's root, as a share of its reach: it shows which way the petals point."""
DISC_OPACITY = 0.4
"""Of standing vehicles: they must not hide those that go."""
FEW_VEHICLES = 12
"""Of more, lines are thin: they would hide the map."""

INK = "0.15"
CELL_GREY = "0.87"
TRACK_GREY = "0.45"
TRACKS_OPACITY, FAINTEST_TRACK, BOLDEST_TRACK = 60.0, 0.15, 0.7
"""Of all tracks together where they lie over each other, and the limits of each one's."""
FOCUS_COLOR = "#D55E00"
OTHER_COLOR = "#0072B2"
"""Of Okabe and Ito (2008): the vehicle that a figure is about, and all others."""


def draw_map(axes: Axes, primitives: PrimitiveMap, *, opacity: float = 1.0) -> ScalarMappable:
    """Cells and roses; -> the colours of speed, for a colour bar."""
    petals = shapes.rose_petals(primitives)
    fastest = shapes.fastest_speed(petals)
    outlines = shapes.cell_outlines(primitives.tessellation)
    axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.4, zorder=1))
    color = shapes.petal_colors(petals, fastest=fastest)[:, 1] / 255.0
    color[:, 3] = np.where(petals.is_disc, DISC_OPACITY * opacity, opacity)
    axes.add_collection(PolyCollection(list(petals.polygon), facecolors=color, linewidths=0, zorder=3))
    _, first = np.unique(petals.cell, return_index=True)
    width = ROOT_DIAMETER * petals.reach[first]
    axes.add_collection(
        EllipseCollection(
            width, width, np.zeros_like(width), offsets=petals.polygon[first, 0], offset_transform=axes.transData,
            units="xy", facecolors=INK, alpha=opacity, linewidths=0, zorder=4,
        )
    )  # fmt: skip
    steps = speed_color(np.linspace(0.0, 1.0, 256), fastest=1.0) / 255.0
    return ScalarMappable(Normalize(0.0, fastest), ListedColormap(steps))


def draw_tracks(axes: Axes, tracks: Tracks) -> None:
    """Observed motion, as thin lines under the roses, fainter the more there are."""
    paths = paths_of(tracks.vehicle, tracks.time_ns, tracks.position)
    opacity = float(np.clip(TRACKS_OPACITY / max(len(paths), 1), FAINTEST_TRACK, BOLDEST_TRACK))
    axes.add_collection(LineCollection(paths, colors=TRACK_GREY, linewidths=0.6, alpha=opacity, zorder=2))


def draw_estimates(axes: Axes, estimates: Estimates, focus: Collection[str] = ()) -> None:
    """The way of each vehicle, of those in focus in a colour of their own; thin and faint where it coasts."""
    names = estimates.track_id.astype(np.str_)
    usual = 1.6 if np.unique(names).size <= FEW_VEHICLES else 0.8
    for coasts, width, opacity in ((False, usual, 1.0), (True, 0.3 * usual, 0.6)):
        for is_other in (True, False):
            own = (estimates.is_coasting == coasts) & (np.isin(names, list(focus)) != is_other)
            axes.add_collection(
                LineCollection(
                    paths_of(names[own], estimates.time_ns[own], estimates.position[own]),
                    colors=OTHER_COLOR if is_other else FOCUS_COLOR, linewidths=width, alpha=opacity,
                    capstyle="round", zorder=6,
                )
            )  # fmt: skip


def draw_forecast(axes: Axes, paths: FloatArray, color: str, *, opacity: float) -> None:
    """Rollouts of one vehicle, (n_samples, n_steps, 2) metres, as thin lines with a dot at their ends."""
    axes.add_collection(LineCollection(list(paths), colors=color, linewidths=0.7, alpha=opacity, zorder=5))
    axes.plot(
        *paths[:, -1].T, ".", color=color, markersize=3.5, alpha=min(1.0, 2 * opacity), markeredgewidth=0, zorder=5
    )


def draw_frame(axes: Axes, frame: TrackedFrame, truth: Tracks | None, focus: Collection[str] = ()) -> None:
    """Detections, estimates with their ellipses and, where known, the vehicles themselves, at one instant.

    Of those in focus the particles too, coloured by direction.
    """
    if truth is not None:
        now = truth.time_ns == frame.time_ns
        outline = shapes.vehicle_outline(truth.position[now], truth.body_direction[now], truth.size[now])
        axes.add_collection(PolyCollection(list(outline), facecolors="white", alpha=0.6, linewidths=0, zorder=6.5))
        axes.add_collection(LineCollection(list(outline), colors=INK, linewidths=0.9, zorder=7))
    axes.plot(*frame.detections.position.T, "x", color=INK, markersize=4.5, markeredgewidth=1.1, zorder=9)
    for row in np.flatnonzero(np.isin(frame.names, list(focus))).tolist():
        cloud = frame.particles.of(row)
        x, y = cloud.position.T
        axes.scatter(x, y, s=1.0, c=direction_color(cloud.direction) / 255.0, linewidths=0, zorder=7.5)
    seen = frame.estimates[~may_be_anywhere(frame.estimates)]
    shades = [FOCUS_COLOR if name in focus else OTHER_COLOR for name in seen.track_id.astype(np.str_)]
    ellipse = shapes.covariance_ellipse(seen.position, seen.covariance, probability=CONFIDENCE)
    axes.add_collection(LineCollection(list(ellipse), colors=shades, linewidths=1.4, zorder=8))
    x, y = seen.position.T
    axes.scatter(x, y, s=14.0, c=shades, edgecolors="white", linewidths=0.8, zorder=10)


def paths_of(track_id: AnyArray, time_ns: IntArray, position: FloatArray) -> list[FloatArray]:
    """The line of each vehicle, split where it was unseen for longer than `MAX_GAP_S`."""
    _, vehicle = np.unique(track_id, return_inverse=True)
    order = np.lexsort((time_ns, vehicle))
    gap = np.diff(time_ns[order]) > MAX_GAP_S * 1e9
    return np.split(position[order], np.flatnonzero(gap | (np.diff(vehicle[order]) != 0)) + 1)
