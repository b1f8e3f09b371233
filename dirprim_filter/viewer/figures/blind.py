"""Which tracks last through a ring without detections: the picture that `dirprim demo --scene blind` ends with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import DOTS_PER_INCH, LARGE, NORMAL, add_axes, dress, dress_map
from dirprim_filter.viewer.layers import INK, draw_estimates, draw_frame, draw_map

RING_GREY = "0.88"
LOST_GREY = "0.7"
CHANGE: dict[str, Any] = {"markersize": 7, "markerfacecolor": "none", "markeredgecolor": INK, "markeredgewidth": 1.2}
WAY_S = 5.0
"""Seconds of the way that tracks have come, on the plan."""
REACH_M = 62.0
"""Metres from the middle to the border of the plan."""
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
"""Of Okabe and Ito (2008)."""
PANEL, ROW, KEY = 3.3, 3.85, 0.95
"""Inches: the height of a panel, of a row of panels, and below them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One way of tracking.

    Attributes:
        name: of the way.
        estimates: of the whole log.
        frame: of the instant shown on the plan.
        follower: (n,) str, the track that follows each row of the truth; empty where none does.
    """

    name: str
    estimates: Estimates
    frame: TrackedFrame
    follower: AnyArray


def blind_figure(primitives: PrimitiveMap, *, truth: Tracks, ways: Sequence[Way], ring: tuple[float, float]) -> Figure:
    """A row for each way: tracks on the plan at one instant, and who follows each vehicle over the whole time.

    Args:
        primitives: the map.
        truth: where the vehicles truly were.
        ways: of tracking, with the same instant.
        ring: metres, the inner and outer borders of the square ring without detections.

    Raises:
        ValueError: no way.
    """
    if not ways:
        raise ValueError("ways: expected at least one, got none")
    figure = Figure(figsize=(13.0, ROW * len(ways) + 0.75), dpi=DOTS_PER_INCH)
    along = along_the_way(truth)
    for i, way in enumerate(ways):
        bottom = KEY + ROW * (len(ways) - 1 - i)
        color = colors_of(truth, way.follower)
        plan, courses = add_axes(figure, (0.62, bottom, PANEL, PANEL)), add_axes(figure, (4.6, bottom, 8.2, PANEL))
        _draw_plan(plan, primitives, truth, way, color=color, ring=ring)
        changed = _draw_courses(courses, truth, along, way, color=color, ring=ring)
        inside = (np.abs(along) >= ring[0]) & (np.abs(along) <= ring[1])
        followed = f"{(way.follower[inside] != '').mean():.0%} followed in the ring".replace("%", " %")
        changes = f"{changed or 'no'} change{'s' * (changed != 1)} of track"
        for axes, letter, title in (
            (plan, "ac"[i % 2], f"{way.name.capitalize()}, {way.frame.time_ns * 1e-9:.1f} s"),
            (courses, "bd"[i % 2], f"Vehicles, coloured by the track that follows them: {followed}, {changes}"),
        ):
            axes.set_title(f"({letter})  {title}", loc="left", fontsize=LARGE)
            if i < len(ways) - 1:
                axes.set(xlabel="", xticklabels=[])
    _draw_key(add_axes(figure, (2.6, 0.02, 10.2, 0.33)))
    return figure


def along_the_way(truth: Tracks) -> FloatArray:
    """(n,) metres from the middle, max(|x|, |y|): below 0 until a vehicle is nearest to it, above from then on."""
    reach = np.abs(truth.position).max(axis=1)
    nearest = np.full(truth.n_tracks, np.inf)
    np.minimum.at(nearest, truth.vehicle, reach)
    turned_ns = np.zeros(truth.n_tracks, np.int64)
    turns = np.flatnonzero(reach == nearest[truth.vehicle])
    np.maximum.at(turned_ns, truth.vehicle[turns], truth.time_ns[turns])
    return np.asarray(np.where(truth.time_ns <= turned_ns[truth.vehicle], -reach, reach), np.float64)


def changes_of(truth: Tracks, follower: AnyArray) -> IntArray:
    """(c,) rows of the truth at which a vehicle is followed by another track than when it was last followed."""
    rows = np.flatnonzero(follower != "")
    order = rows[np.lexsort((truth.time_ns[rows], truth.vehicle[rows]))]
    same = truth.vehicle[order[1:]] == truth.vehicle[order[:-1]]
    return np.asarray(order[1:][same & (follower[order[1:]] != follower[order[:-1]])])


def colors_of(truth: Tracks, follower: AnyArray) -> dict[str, str]:
    """Of each track that follows a vehicle a colour: another one than those of others that follow the same."""
    rows = np.flatnonzero(follower != "")
    color: dict[str, str] = {}
    rivals: dict[str, set[str]] = {}
    for vehicle in range(truth.n_tracks):
        own = set(follower[rows[truth.vehicle[rows] == vehicle]].tolist())
        for name in own:
            rivals.setdefault(name, set()).update(own - {name})
    for number, name in enumerate(dict.fromkeys(follower[rows].tolist())):
        taken = {color.get(other) for other in rivals[name]}
        turned = PALETTE[number % len(PALETTE) :] + PALETTE[: number % len(PALETTE)]
        color[name] = next((shade for shade in turned if shade not in taken), turned[0])
    return color


# --- The panels ----------------------------------------------------------------------------------------


def _draw_plan(
    axes: Axes, primitives: PrimitiveMap, truth: Tracks, way: Way, *, color: Mapping[str, str],
    ring: tuple[float, float],
) -> None:  # fmt: skip
    near, far = (of * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) for of in ring)
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY]
    hole = Path(np.concatenate([far, near[::-1]]), codes * 2)
    axes.add_patch(PathPatch(hole, facecolor=RING_GREY, linewidth=0, zorder=0))
    draw_map(axes, primitives, opacity=0.25)
    age_ns = way.frame.time_ns - way.estimates.time_ns
    recent = way.estimates[(age_ns >= 0) & (age_ns <= WAY_S * 1e9)]
    shade = {name: color.get(name, LOST_GREY) for name in recent.track_id.astype(np.str_).tolist()}
    draw_estimates(axes, recent, shade)
    draw_frame(axes, way.frame, truth, shade, marker=3.5)
    dress_map(axes, REACH_M * np.array([[-1.0, -1.0], [1.0, 1.0]]))


def _draw_courses(
    axes: Axes, truth: Tracks, along: FloatArray, way: Way, *, color: Mapping[str, str], ring: tuple[float, float]
) -> int:
    """-> how often a vehicle is followed by another track than before."""
    for side in (-1.0, 1.0):
        axes.axhspan(side * ring[0], side * ring[1], color=RING_GREY, linewidth=0, zorder=0)
    order = np.lexsort((truth.time_ns, truth.vehicle))
    place = np.column_stack([truth.time_ns * 1e-9, along])[order]
    vehicle, follower = truth.vehicle[order], way.follower[order]
    apart = np.flatnonzero((np.diff(vehicle) != 0) | (follower[1:] != follower[:-1])) + 1
    for rows in np.split(np.arange(order.size), apart):
        name, last = str(follower[rows[0]]), rows[-1] + 1
        more = last < order.size and vehicle[last] == vehicle[rows[0]]  # up to where the next one begins
        line = place[rows[0] : last + more]
        width, shade = (1.8, color[name]) if name else (0.8, LOST_GREY)
        axes.add_collection(
            LineCollection([line], colors=shade, linewidths=width, capstyle="butt", zorder=4 + bool(name))
        )
    changed = changes_of(truth, way.follower)
    axes.plot(truth.time_ns[changed] * 1e-9, along[changed], "o", zorder=8, **CHANGE)
    axes.axvline(way.frame.time_ns * 1e-9, color=INK, linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
    reach = 1.02 * float(np.abs(along).max())
    axes.set(xlim=(place[:, 0].min(), place[:, 0].max()), ylim=(-reach, reach))
    axes.set(xlabel="time [s]", ylabel="from the middle [m]")
    dress(axes)
    return int(changed.size)


def _draw_key(axes: Axes) -> None:
    """What the marks mean."""
    marks = [
        Patch(facecolor=RING_GREY, label="no detections here"),
        Line2D([], [], linewidth=1.8, color=PALETTE[0], label="followed by a track"),
        Line2D([], [], linewidth=0.8, color=LOST_GREY, label="by none"),
        Line2D([], [], linewidth=0, marker="o", label="its track changes", **CHANGE),
        Line2D([], [], linewidth=0, marker="x", color=INK, label="detection"),
        Line2D([], [], linewidth=0.9, color=INK, label="true vehicle"),
    ]
    axes.legend(
        handles=marks, loc="upper left", ncols=6, frameon=False, borderpad=0.0, borderaxespad=0.0, fontsize=NORMAL
    )
    axes.axis("off")
