"""A primitive at one place: its directions, on a line and around a circle (Eq. 1), and its speeds (Eq. 3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import Gamma, von_mises
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import (
    LARGE,
    add_axes,
    add_polar_axes,
    dress_directions,
    dress_polar,
    open_frame,
    panels_above_key,
)
from dirprim_filter.viewer.figures.place import Circle, Mode, Place
from dirprim_filter.viewer.layers import INK, STANDING_SPEED

BIN_DEG = 5
BINS_OF_SPEED = 30
ROWS_COLOR = "0.85"
REST: Mapping[str, Any] = {"facecolor": "none", "edgecolor": "0.6", "hatch": "//////", "linewidth": 0.4}
MEAN: Mapping[str, Any] = {"color": "0.35", "linewidth": 1.0, "linestyle": (0, (1, 1))}
MEAN_OVER = 200
"""Positions, about."""
OPACITY = 0.45
"""Of a mode's area: where modes overlap, both are seen."""


def direction_figure(
    primitives: PrimitiveMap, *, position: npt.ArrayLike | None = None, tracks: Tracks | None = None
) -> Figure:
    """p(direction) at a place, with its modes: linear and polar, and where the place is.

    Args:
        primitives: the map.
        position: (2,) metres; default: the centre of the cell with the most different directions.
        tracks: moving rows in the same cell, drawn as a histogram of direction.

    Raises:
        ValueError: no cell covers the position.
    """
    place = Place.at(primitives, position)
    circle = Circle.around(place.direction)
    modes = place.modes()
    moving = None if tracks is None else _moving(place.rows_of(tracks))
    rest = 1.0 - sum(mode.weight for mode in modes)
    key: list[Artist] = [Line2D([], [], color=INK, linewidth=1.2, label="p(direction) at the place")]
    key += [_mode_mark(mode, f"concentration {mode.concentration:,.3g}") for mode in modes]
    key.append(_rest_mark(f"standing, and the place-free primitive: {rest:.1%}"))
    if moving is not None:
        key.append(Patch(color=ROWS_COLOR, label=f"the cell's {len(moving):,} rows of moving vehicles"))
    mean_drawn = moving is not None and len(moving) > 0 and bool(primitives.bend[place.cell].any())
    if mean_drawn:
        key.append(Line2D([], [], **MEAN, label="p(direction), mean over where these rows are"))
    figure, bottom = panels_above_key(width=11.6, height=2.6, key=key, n_columns=3)
    line = add_axes(figure, (0.65, bottom, 4.5, 2.6))
    polar = add_polar_axes(figure, (5.75, bottom, 2.45, 2.45))
    densest = _draw_directions(line, polar, place, modes, circle)
    if moving is not None and len(moving):
        densest = max(densest, _draw_row_directions(line, polar, moving, circle))
        if mean_drawn:
            density = _mean_density(primitives, moving, circle.theta)
            line.plot(circle.degrees, density, **MEAN)
            polar.plot(circle.theta, np.sqrt(density), **MEAN)
    line.set_ylim(0.0, 1.06 * densest)
    dress_polar(polar, densest=densest, free=circle.start)
    line.set_title(f"(a)  Directions at {place.title}", loc="left", fontsize=LARGE)
    polar.set_title("(b)  Around the circle", loc="left", fontsize=LARGE, x=-0.15, y=1.1)
    _add_surroundings(figure, place, tracks, box=(9.15, bottom, 2.3, 2.45), letter="c")
    return figure


def speed_figure(
    primitives: PrimitiveMap, *, position: npt.ArrayLike | None = None, tracks: Tracks | None = None
) -> Figure:
    """p(speed) at a place, with the gamma of each mode in the colour of the mode's direction.

    Vehicles that stand have a share, but no curve: their density at 0 would dwarf all others.

    Args:
        primitives: the map.
        position: (2,) metres; default: the centre of the cell with the most different directions.
        tracks: moving rows in the same cell, drawn as a histogram of speed.

    Raises:
        ValueError: no cell covers the position.
    """
    place = Place.at(primitives, position)
    modes = place.modes()
    rows = None if tracks is None else place.rows_of(tracks)
    standing = place.standing()
    rest = 1.0 - standing - sum(mode.weight for mode in modes)
    key: list[Artist] = [Line2D([], [], color=INK, linewidth=1.2, label="p(speed) at the place")]
    key += [_mode_mark(mode, f"{mode.speed.mean:.1f} ± {_std(mode.speed):.1f} m/s") for mode in modes]
    key.append(_rest_mark(f"place-free: {rest:.1%}; standing, not drawn: {standing:.1%}"))
    if rows is not None:
        key.append(Patch(color=ROWS_COLOR, label=f"the cell's {len(rows):,} rows"))
    figure, bottom = panels_above_key(width=8.6, height=2.6, key=key, n_columns=2)
    axes = add_axes(figure, (0.65, bottom, 4.6, 2.6))
    fastest = _fastest(modes, rows)
    _draw_speeds(axes, place, modes, fastest)
    if rows is not None and len(rows):
        _draw_row_speeds(axes, rows, fastest)
    axes.set_title(f"(a)  Speeds at {place.title}", loc="left", fontsize=LARGE)
    _add_surroundings(figure, place, tracks, box=(6.1, bottom, 2.3, 2.45), letter="b")
    return figure


# --- Directions ----------------------------------------------------------------------------------------


def _draw_directions(line: Axes, polar: PolarAxes, place: Place, modes: list[Mode], circle: Circle) -> float:
    """-> the greatest density."""
    total = np.exp(place.direction.log_density(circle.theta))
    parts = [_direction_density(mode, circle.theta) for mode in modes]
    rest = np.maximum(total - sum(parts, np.zeros_like(total)), 0.0)
    line.fill_between(circle.degrees, rest, **REST)
    polar.fill_between(circle.theta, np.sqrt(rest), **REST)
    for mode, part in zip(modes, parts, strict=True):
        line.fill_between(circle.degrees, part, color=mode.color, alpha=OPACITY, linewidth=0)
        polar.fill_between(circle.theta, np.sqrt(part), color=mode.color, alpha=OPACITY, linewidth=0)
        line.plot(circle.degrees, part, color=mode.color, linestyle=mode.dashes, linewidth=1.0)
    line.plot(circle.degrees, total, color=INK, linewidth=1.2)
    polar.plot(circle.theta, np.sqrt(total), color=INK, linewidth=1.0)
    line.set(ylabel="density [1/rad]")
    dress_directions(line, start=circle.start)
    return float(total.max())


def _draw_row_directions(line: Axes, polar: PolarAxes, rows: Tracks, circle: Circle) -> float:
    """-> the greatest density."""
    edges = np.deg2rad(np.arange(0, 361, BIN_DEG)) + circle.start
    density, _ = np.histogram(np.deg2rad(circle.degrees_of(rows.direction)), edges, density=True)
    line.stairs(density, np.rad2deg(edges), fill=True, color=ROWS_COLOR, zorder=0)
    width = np.deg2rad(BIN_DEG)
    polar.bar(edges[:-1], np.sqrt(density), width=width, align="edge", color=ROWS_COLOR, linewidth=0, zorder=0)
    return float(density.max())


def _mean_density(primitives: PrimitiveMap, rows: Tracks, theta: FloatArray) -> FloatArray:
    """p(direction) where the rows are, averaged: what their histogram is to be compared with, if primitives bend."""
    some = rows.position[:: max(1, len(rows) // MEAN_OVER)]
    density = [np.exp(primitives.primitive_at(place).direction.log_density(theta)) for place in some]
    return np.asarray(np.mean(density, axis=0))


def _direction_density(mode: Mode, theta: FloatArray) -> FloatArray:
    mean, concentration = np.array(mode.mean_direction), np.array(mode.concentration)
    return np.asarray(mode.weight * np.exp(von_mises.log_density(theta, mean, concentration)))


# --- Speeds --------------------------------------------------------------------------------------------


def _draw_speeds(axes: Axes, place: Place, modes: list[Mode], fastest: float) -> None:
    speed = np.linspace(0.0, fastest, 1001)[1:]
    weight, gamma = place.direction.weight, place.speed
    moving = gamma.mean >= STANDING_SPEED
    total = (weight[moving] * np.exp(gamma[moving].log_density(speed[:, None]))).sum(axis=-1)
    parts = [mode.weight * np.exp(mode.speed.log_density(speed)) for mode in modes]
    rest = np.maximum(total - sum(parts, np.zeros_like(total)), 0.0)
    axes.fill_between(speed, rest, **REST)
    for mode, part in zip(modes, parts, strict=True):
        axes.fill_between(speed, part, color=mode.color, alpha=OPACITY, linewidth=0)
        axes.plot(speed, part, color=mode.color, linestyle=mode.dashes, linewidth=1.2)
    axes.plot(speed, total, color=INK, linewidth=1.2)
    axes.set(
        xlabel="speed [m/s]", ylabel="density [s/m]", xlim=(0.0, fastest), ylim=(0.0, 1.08 * _tallest(parts, total))
    )
    open_frame(axes)


def _draw_row_speeds(axes: Axes, rows: Tracks, fastest: float) -> None:
    """A histogram of all rows, of which only those that move are drawn: its area is their share."""
    edges = np.linspace(0.0, fastest, BINS_OF_SPEED + 1)
    counts, _ = np.histogram(rows.speed[rows.speed >= STANDING_SPEED], edges)
    density = counts / (len(rows) * edges[1])
    axes.stairs(density, edges, fill=True, color=ROWS_COLOR, zorder=0)
    axes.set_ylim(top=max(axes.get_ylim()[1], 1.06 * density.max()))


def _fastest(modes: list[Mode], rows: Tracks | None) -> float:
    """Where the speed axis ends: past what the modes reach, and the rows."""
    ends = [float(mode.speed.mean) + 4.0 * _std(mode.speed) for mode in modes]
    if rows is not None and len(rows):
        ends.append(1.05 * float(rows.speed.max()))
    return float(np.ceil(max([1.0, *ends])))


def _tallest(parts: list[FloatArray], total: FloatArray) -> float:
    return float(max(total.max(), *(part.max() for part in parts), 1e-6))


def _std(speed: Gamma) -> float:
    return float(np.sqrt(speed.shape) / speed.rate)


# --- Around them ---------------------------------------------------------------------------------------


def _add_surroundings(
    figure: Figure, place: Place, tracks: Tracks | None, *, box: tuple[float, float, float, float], letter: str
) -> None:
    axes = add_axes(figure, box)
    place.draw(axes, tracks)
    axes.set_title(f"({letter})  The place", loc="left", fontsize=LARGE)


def _moving(rows: Tracks) -> Tracks:
    return rows[rows.speed >= STANDING_SPEED]


def _mode_mark(mode: Mode, speed: str) -> Patch:
    label = f"mode {mode.number}: {mode.weight:.1%}, {mode.degrees}, {speed}"
    shade = to_rgba(mode.color, OPACITY)
    return Patch(facecolor=shade, edgecolor=mode.color, linestyle=mode.dashes, label=label)


def _rest_mark(label: str) -> Patch:
    return Patch(label=label, **REST)
