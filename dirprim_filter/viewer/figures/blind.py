"""Which tracks last through a ring without detections: the picture that `dirprim demo --scene blind` ends with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import NORMAL, dress, new_figure
from dirprim_filter.viewer.layers import INK

RING_GREY = "0.88"
LOST_GREY = "0.7"
CHANGE: dict[str, Any] = {"markersize": 7, "markerfacecolor": "none", "markeredgecolor": INK, "markeredgewidth": 1.2}
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
"""Of Okabe and Ito (2008)."""


def blind_figure(truth: Tracks, followers: Mapping[str, AnyArray], *, ring: tuple[float, float]) -> Figure:
    """A row for each way of tracking: who follows each vehicle over the whole time.

    Args:
        truth: where the vehicles truly were.
        followers: by way, (n,) str, the track that follows each row of the truth; empty where none does.
        ring: metres, the inner and outer borders of the square ring without detections.

    Raises:
        ValueError: no way.
    """
    if not followers:
        raise ValueError("followers: expected at least one way of tracking, got none")
    figure = new_figure(11.0, 0.6 + 3.3 * len(followers))
    panels = figure.subplots(len(followers), 1, sharex=True, squeeze=False)[:, 0]
    along = along_the_way(truth)
    inside = (np.abs(along) >= ring[0]) & (np.abs(along) <= ring[1])
    for axes, (name, follower) in zip(panels, followers.items(), strict=True):
        changed = _draw_courses(axes, truth, along, follower, ring=ring)
        share, plural = 100.0 * (follower[inside] != "").mean(), "s" * (changed != 1)
        dress(
            axes, f"{name.capitalize()}: {share:.0f} % followed in the ring, {changed or 'no'} change{plural} of track"
        )
    panels[-1].set_xlabel("time [s]", fontsize=NORMAL)
    marks = [
        Patch(facecolor=RING_GREY, label="no detections here"),
        Line2D([], [], linewidth=1.8, color=PALETTE[0], label="a vehicle, in the colour of the track that follows it"),
        Line2D([], [], linewidth=0.8, color=LOST_GREY, label="followed by none"),
        Line2D([], [], linewidth=0, marker="o", label="its track changes", **CHANGE),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=NORMAL)
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


def _draw_courses(
    axes: Axes, truth: Tracks, along: FloatArray, follower: AnyArray, *, ring: tuple[float, float]
) -> int:
    """-> how often a vehicle is followed by another track than before."""
    for side in (-1.0, 1.0):
        axes.axhspan(side * ring[0], side * ring[1], color=RING_GREY, linewidth=0, zorder=0)
    color = colors_of(truth, follower)
    order = np.lexsort((truth.time_ns, truth.vehicle))
    place, vehicle, names = np.column_stack([truth.time_ns * 1e-9, along])[order], truth.vehicle[order], follower[order]
    apart = np.flatnonzero((np.diff(vehicle) != 0) | (names[1:] != names[:-1])) + 1
    for rows in np.split(np.arange(order.size), apart):
        name, last = str(names[rows[0]]), rows[-1] + 1
        more = last < order.size and vehicle[last] == vehicle[rows[0]]  # up to where the next one begins
        width, shade = (1.8, color[name]) if name else (0.8, LOST_GREY)
        line = place[rows[0] : last + more]
        axes.add_collection(
            LineCollection([line], colors=shade, linewidths=width, capstyle="butt", zorder=4 + bool(name))
        )
    changed = changes_of(truth, follower)
    axes.plot(truth.time_ns[changed] * 1e-9, along[changed], "o", zorder=8, **CHANGE)
    reach = 1.02 * float(np.abs(along).max())
    axes.set(xlim=(place[:, 0].min(), place[:, 0].max()), ylim=(-reach, reach), ylabel="from the middle [m]")
    return int(changed.size)
