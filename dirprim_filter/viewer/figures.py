"""Figures for papers and pages: the learned map, and what tracking with it looks like.

Drawn through matplotlib's objects and never through pyplot: nothing global changes and no window opens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Wedge
from matplotlib.ticker import MaxNLocator

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import shapes
from dirprim_filter.viewer.colors import direction_color, speed_color, track_color
from tessellation.arrays import AnyArray, FloatArray, IntArray

Forecasts = Mapping[str, FloatArray]
"""Sampled futures by track id, (n_samples, n_steps, 2) metres each."""

Rgb = tuple[float, float, float]

CONFIDENCE = 0.9
MAX_GAP_S = 2.0
"""A vehicle unseen for longer is drawn as two lines."""
DOTS_PER_INCH = 160
INK = "0.15"
CELL_GREY = "0.86"
TRACK_GREY = "0.55"
CLOSE_UP = 4.0
"""Metres from the vehicle to the border of the close-up of its particles, at least."""


def map_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
) -> Figure:
    """The learned map: cells, and roses coloured by mean speed.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines in their colours.
        forecasts: sampled futures.
    """
    figure = Figure(figsize=(7.2, 6.4), dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.add_subplot()
    colors = _draw_map(axes, primitives, tracks)
    if estimates is not None:
        _draw_estimates(axes, estimates)
    _draw_forecasts(axes, forecasts or {})
    _dress(axes, shapes.map_extent(primitives))
    figure.colorbar(colors, ax=axes, label="mean speed [m/s]", shrink=0.7, pad=0.02)
    return figure


def demo_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks,
    frame: TrackedFrame,
    estimates: Estimates,
    truth: Tracks | None = None,
    forecasts: Forecasts | None = None,
    focus: str | None = None,
) -> Figure:
    """What was learned, and one vehicle tracked with it.

    Args:
        primitives: the map.
        tracks: what it was learned from.
        frame: the instant shown on the right.
        estimates: of the whole log: the way that the vehicles have come.
        truth: where the vehicles truly were.
        forecasts: sampled futures from `frame` on.
        focus: the vehicle shown; the first of the forecasts, else of the frame, if absent.

    Raises:
        ValueError: the frame holds no vehicle, or not that one.
    """
    forecasts = forecasts or {}
    row = _focus_row(frame, forecasts, focus)
    figure = Figure(figsize=(14.0, 5.9), dpi=DOTS_PER_INCH, layout="constrained")
    panels = figure.subplot_mosaic(
        [["learned", "tracked", "close up"], ["learned", "tracked", "legend"]],
        width_ratios=[1.18, 1.08, 0.58], height_ratios=[1.0, 0.8],
    )  # fmt: skip
    learned, tracked = panels["learned"], panels["tracked"]
    colors = _draw_map(learned, primitives, tracks)
    _dress(learned, shapes.map_extent(primitives))
    learned.set_title("Learned: how vehicles move at each place", loc="left")
    figure.colorbar(colors, ax=learned, label="mean speed [m/s]", shrink=0.7, pad=0.02)

    _draw_map(tracked, primitives, None, opacity=0.35)
    _draw_estimates(tracked, _until(estimates, frame.time_ns))
    _draw_forecasts(tracked, _from_here(forecasts, frame.estimates))
    _draw_frame(tracked, frame, truth)
    name = str(frame.estimates.track_id[row])
    _dress(tracked, _window(frame.estimates.position[row], forecasts.get(name)))
    tracked.set_title(f"Tracked: vehicle {name}", loc="left")

    _draw_close_up(panels["close up"], primitives, frame, truth, row)
    tracked.indicate_inset_zoom(panels["close up"], edgecolor=INK)
    _draw_legend(panels["legend"], _color(name), has_truth=truth is not None)
    return figure


def save_figure(figure: Figure, path: Path, *, force: bool = False) -> None:
    """Write a figure in the format of the path's suffix; under a temporary name until it is whole.

    Raises:
        FileExistsError: the file exists and `force` is not given.
        ValueError: a suffix that is no format of matplotlib.
    """
    if path.exists() and not force:
        raise FileExistsError(f"{path}: exists already; overwrite it with --force or choose another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    figure.savefig(part, bbox_inches="tight")
    part.replace(path)


# --- What is drawn -------------------------------------------------------------------------------------


def _draw_map(axes: Axes, primitives: PrimitiveMap, tracks: Tracks | None, *, opacity: float = 1.0) -> ScalarMappable:
    """Cells, tracks and roses from below; -> the colours of speed, for a colour bar."""
    petals = shapes.rose_petals(primitives)
    fastest = shapes.fastest_speed(petals)
    outlines = shapes.cell_outlines(primitives.tessellation)
    axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.5, zorder=1))
    if tracks is not None:
        paths = _paths(tracks.track_id, tracks.time_ns, tracks.position)
        axes.add_collection(LineCollection(paths, colors=TRACK_GREY, linewidths=0.3, alpha=0.25, zorder=2))
    face = speed_color(petals.mean_speed, fastest=fastest) / 255.0
    axes.add_collection(
        PolyCollection(list(petals.polygon), facecolors=face, edgecolors=INK, linewidths=0.25, alpha=opacity, zorder=3)
    )
    root = petals.polygon[:, 0]
    axes.plot(root[:, 0], root[:, 1], ".", color=INK, markersize=1.6, alpha=opacity, zorder=4)
    steps = speed_color(np.linspace(0.0, 1.0, 256), fastest=1.0) / 255.0
    return ScalarMappable(Normalize(0.0, fastest), ListedColormap(steps))


def _draw_estimates(axes: Axes, estimates: Estimates) -> None:
    for name in np.unique(estimates.track_id):
        rows = estimates.track_id == name
        paths = _paths(estimates.track_id[rows], estimates.time_ns[rows], estimates.position[rows])
        axes.add_collection(LineCollection(paths, colors=_color(name), linewidths=1.6, zorder=6))


def _draw_forecasts(axes: Axes, forecasts: Forecasts) -> None:
    for name, paths in forecasts.items():
        color = _color(name)
        axes.add_collection(LineCollection(list(paths), colors=color, linewidths=0.8, alpha=0.3, zorder=5))
        axes.plot(*paths[:, -1].T, ".", color=color, markersize=3.0, alpha=0.7, markeredgewidth=0, zorder=5)


def _draw_frame(axes: Axes, frame: TrackedFrame, truth: Tracks | None, *, marker: float = 4.0) -> None:
    """Detections, estimates with their ellipses and, where known, the vehicles themselves, at one instant."""
    estimates = frame.estimates
    if truth is not None:
        now = truth.time_ns == frame.time_ns
        outline = shapes.vehicle_outline(truth.position[now], truth.direction[now])
        axes.add_collection(LineCollection(list(outline), colors=INK, linewidths=1.2, zorder=7))
    axes.plot(*frame.detections.position.T, "x", color=INK, markersize=1.5 * marker, markeredgewidth=1.4, zorder=9)
    ellipse = shapes.covariance_ellipse(estimates.position, estimates.covariance, probability=CONFIDENCE)
    for row, name in enumerate(estimates.track_id):
        color = _color(name)
        axes.plot(*ellipse[row].T, color=color, linewidth=1.8, zorder=8)
        axes.plot(*estimates.position[row], "o", color=color, markersize=marker, markeredgecolor="white", zorder=10)


def _draw_close_up(axes: Axes, primitives: PrimitiveMap, frame: TrackedFrame, truth: Tracks | None, row: int) -> None:
    """The particles of one vehicle, coloured by direction, larger where they weigh more."""
    estimates, particles = frame.estimates, frame.particles
    _draw_map(axes, primitives, None, opacity=0.15)
    mine = particles.vehicle == row
    axes.scatter(
        particles.position[mine, 0],
        particles.position[mine, 1],
        s=6.0 * np.sqrt(particles.weight[mine] * mine.sum()),
        c=direction_color(particles.direction[mine]) / 255.0,
        linewidths=0,
        zorder=6,
    )
    _draw_frame(axes, frame, truth, marker=6.0)
    half_axes, _ = shapes.covariance_axes(estimates.covariance[row], probability=CONFIDENCE)
    half = max(CLOSE_UP, 1.3 * float(half_axes.max()))
    _dress(axes, estimates.position[row] + half * np.array([[-1.0], [1.0]]))
    axes.set(xlabel="", ylabel="", title="its particles")
    axes.spines[["top", "right"]].set_visible(True)


def _draw_legend(axes: Axes, color: Rgb, *, has_truth: bool) -> None:
    """What the marks mean, and a ring with the colours of direction."""
    marks = [
        Line2D([], [], color=color, linewidth=1.6, label="estimates so far"),
        Line2D(
            [],
            [],
            color=color,
            linewidth=1.8,
            marker="o",
            markeredgecolor="white",
            label="now, with 90 % region",
        ),
        Line2D([], [], color=color, linewidth=0.8, alpha=0.6, marker=".", label="sampled futures"),
        Line2D([], [], color=INK, linewidth=0, marker="x", markeredgewidth=1.4, label="detection"),
    ]
    if has_truth:
        marks.append(Line2D([], [], color=INK, linewidth=1.2, label="true vehicle"))
    axes.legend(handles=marks, loc="upper left", frameon=False, borderaxespad=0.0)
    axes.axis("off")
    ring = axes.inset_axes((0.0, 0.0, 0.3, 0.4))
    edges = np.linspace(-180.0, 180.0, 73)
    for start, end in pairwise(edges):
        shade = direction_color(np.radians(0.5 * (start + end))) / 255.0
        ring.add_patch(Wedge((0, 0), 1.0, start, end + 0.5, width=0.35, color=shade, linewidth=0))
    for letter, x, y in (("N", 0.0, 0.36), ("E", 0.36, 0.0), ("S", 0.0, -0.36), ("W", -0.36, 0.0)):
        ring.text(x, y, letter, ha="center", va="center", fontsize=6, color=INK)
    ring.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    ring.axis("off")
    axes.text(0.36, 0.2, "particles: their\ndirection", va="center", transform=axes.transAxes)


def _dress(axes: Axes, box: FloatArray) -> None:
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xlabel="east [m]", ylabel="north [m]")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.spines[["top", "right"]].set_visible(False)


# --- What is chosen ------------------------------------------------------------------------------------


def _focus_row(frame: TrackedFrame, forecasts: Forecasts, focus: str | None) -> int:
    names = [str(name) for name in frame.estimates.track_id]
    wanted = focus if focus is not None else next((n for n in forecasts if n in names), next(iter(names), None))
    if wanted not in names:
        raise ValueError(f"focus: vehicle {wanted} is not among the frame's {len(names)}")
    return names.index(wanted)


def _window(position: FloatArray, paths: FloatArray | None) -> FloatArray:
    """A square box (2, 2) around a vehicle and nine in ten of its futures."""
    points = position[None]
    if paths is not None:
        points = np.concatenate([points, np.quantile(paths, [0.05, 0.95], axis=0).reshape(-1, 2)])
    box = shapes.extent(points)
    center, half = box.mean(axis=0), 0.5 * np.ptp(box, axis=0).max() + 5.0
    return np.stack([center - half, center + half])


def _from_here(forecasts: Forecasts, estimates: Estimates) -> Forecasts:
    """Forecasts begin one step ahead; these begin at the vehicle, where it is known."""
    place = {str(name): position for name, position in zip(estimates.track_id, estimates.position, strict=True)}
    return {
        name: np.insert(paths, 0, place[name], axis=1) if name in place else paths for name, paths in forecasts.items()
    }


def _until(estimates: Estimates, time_ns: int) -> Estimates:
    past = estimates.time_ns <= time_ns
    return Estimates(**{f.name: getattr(estimates, f.name)[past] for f in fields(Estimates)})


def _paths(track_id: AnyArray, time_ns: IntArray, position: FloatArray) -> list[FloatArray]:
    """The line of each vehicle, split where it was unseen for longer than `MAX_GAP_S`."""
    _, vehicle = np.unique(track_id, return_inverse=True)
    order = np.lexsort((time_ns, vehicle))
    gap = np.diff(time_ns[order]) > MAX_GAP_S * 1e9
    return np.split(position[order], np.flatnonzero(gap | (np.diff(vehicle[order]) != 0)) + 1)


def _color(name: object) -> Rgb:
    red, green, blue = track_color(np.array([str(name)]))[0, :3] / 255.0
    return float(red), float(green), float(blue)
