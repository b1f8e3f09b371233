"""One place of a map: its directions (Eq. 1) and speeds (Eq. 3), by mode, and what a turn signal adds (Eq. 4)."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color
from dirprim_filter.drawing.shapes import STANDING_SPEED
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import FAINT, FOCUS_COLOR, INK, NORMAL, SMALL, dress, new_figure
from tessellation import OUTSIDE
from tessellation.anchors import anchors

LEAST_WEIGHT = 0.01
"""Modes of less weight are not drawn by themselves."""
BIN_DEG, BINS_OF_SPEED = 5, 30
ANGLES = np.linspace(0.0, TWO_PI, 7201)
OPACITY, ROWS_COLOR, CUE_COLOR = 0.45, "0.85", "#E69F00"


class Place(NamedTuple):
    """A place that a cell covers, what holds there, and a vehicle there that may signal.

    Attributes:
        cell: the cell there.
        position: (2,) metres.
        heading: radians, of the vehicle.
        direction: the mixture of directions, (M,).
        speed: of its modes, (M,).
        shown: the cell's own modes of vehicles that move, the most frequent first.
    """

    cell: int
    position: FloatArray
    heading: float
    direction: VonMisesMixture
    speed: Gamma
    shown: list[int]


def place_at(primitives: PrimitiveMap, position: npt.ArrayLike | None, heading: float | None) -> Place:
    """The place at a position (2,), metres; left out, where most goes different ways, and the usual heading there.

    Raises:
        ValueError: no cell is there, or none holds data.
    """
    cells, own = primitives.tessellation, primitives.n_own_modes
    if position is None:
        if not (primitives.n_rows[:-1] > 0).any():
            raise ValueError("map: expected a cell that holds data, got none; learn it from a log with vehicles")
        moves = primitives.speed.mean[:-1, :own] >= STANDING_SPEED
        rows = primitives.n_rows[:-1, None] * primitives.own_weight * moves
        toward = np.exp(1j * primitives.direction.mean_direction[:-1, :own])
        position = anchors(cells)[np.argmax(rows.sum(axis=-1) - np.abs((rows * toward).sum(axis=-1)))]
    place = np.asarray(position, dtype=np.float64)
    cell = int(cells.cell_of(place))
    if cell == OUTSIDE:
        (west, south), (east, north) = shapes.map_extent(primitives)
        raise ValueError(
            f"position: expected a place in a cell, got ({place[0]:g}, {place[1]:g}) m, outside of all "
            f"{cells.n_cells}; they lie between ({west:.0f}, {south:.0f}) and ({east:.0f}, {north:.0f}) m"
        )
    here = primitives.primitive_at(place)
    often = here.direction.weight * (here.speed.mean >= STANDING_SPEED) * (np.arange(here.speed.mean.size) < own)
    shown = [int(mode) for mode in np.argsort(-often, kind="stable") if often[mode] >= LEAST_WEIGHT]
    if heading is None:
        heading = float(here.direction.mean_direction[np.argmax(often)])
    return Place(cell, place, heading, here.direction, here.speed, shown)


def place_figure(
    primitives: PrimitiveMap, *, position: npt.ArrayLike | None = None, tracks: Tracks | None = None,
    cue: Cue | None = None, heading: float | None = None,
) -> Figure:  # fmt: skip
    """Directions and speeds at a place, by mode.

    Args:
        primitives: the map.
        position: (2,) metres; left out: where going different ways is most usual.
        tracks: rows in the same cell, drawn as histograms.
        cue: a turn signal, drawn with its product with the prior (the paper's Fig. 8).
        heading: radians, of the vehicle that signals; left out, the usual one.

    Raises:
        ValueError: no cell covers the position.
    """
    place = place_at(primitives, position, heading)
    rows = None if tracks is None else tracks[primitives.tessellation.cell_of(tracks.position) == place.cell]
    curves: list[tuple[str, VonMisesMixture, dict[str, Any]]] = [
        ("p(direction) and p(speed) at the place", place.direction, {"color": INK, "linewidth": 1.2})
    ]
    if cue is not None:
        signal = cue.belief(place.heading)
        dashed = {"color": CUE_COLOR, "linewidth": 1.6, "linestyle": (0, (5, 2))}
        posterior = multiply_mixtures(place.direction, signal).mixture
        curves.append(("cue: the turn signal", signal, dashed))
        curves.append(("posterior ∝ p(direction) × cue", posterior, {"color": FOCUS_COLOR, "linewidth": 1.6}))
    key: list[Artist] = [Line2D([], [], label=name, **style) for name, _, style in curves]
    key += [Patch(facecolor=_color(place, mode), alpha=OPACITY, label=_label(place, mode)) for mode in place.shown]
    if rows is not None:
        key.append(Patch(color=ROWS_COLOR, label=f"the cell's {len(rows):,} rows"))
    figure = new_figure(10.0, 4.4)
    figure.legend(handles=key, loc="outside lower center", ncols=3, frameon=False, fontsize=NORMAL)
    grid = figure.add_gridspec(1, 2, width_ratios=[2, 3])
    _draw_directions(cast(PolarAxes, figure.add_subplot(grid[0], projection="polar")), place, curves, rows)
    _draw_speeds(figure.add_subplot(grid[1]), place, rows)
    return figure


def _color(place: Place, mode: int) -> str:
    """That of its direction."""
    return "#" + direction_color(place.direction.mean_direction[mode])[:3].tobytes().hex()


def _label(place: Place, mode: int) -> str:
    """Its share, direction and speed."""
    weight, degrees = place.direction.weight[mode], np.rad2deg(place.direction.mean_direction[mode])
    mean, spread = place.speed.mean[mode], np.sqrt(place.speed.shape[mode]) / place.speed.rate[mode]
    return f"{weight:.1%}: {degrees:+.0f}°, {mean:.1f} ± {spread:.1f} m/s"


def _draw_directions(
    axes: PolarAxes, place: Place, curves: list[tuple[str, VonMisesMixture, dict[str, Any]]], rows: Tracks | None
) -> None:
    """Densities whose areas are to scale, r is their root."""
    for mode in place.shown:
        part = place.direction.weight[mode] * np.exp(place.direction.mode_log_density(ANGLES)[:, mode])
        axes.fill_between(ANGLES, np.sqrt(part), color=_color(place, mode), alpha=OPACITY, linewidth=0)
    densities = [np.exp(mixture.log_density(ANGLES)) for _, mixture, _ in curves]
    for density, (_, _, style) in zip(densities, curves, strict=True):
        axes.plot(ANGLES, np.sqrt(density), **style)
    densest = float(np.max(densities))
    moving = None if rows is None else rows[rows.speed >= STANDING_SPEED]
    if moving is not None and len(moving):
        edges = np.deg2rad(np.arange(0, 361, BIN_DEG))
        share, _ = np.histogram(np.mod(moving.direction, TWO_PI), edges, density=True)
        axes.bar(edges[:-1], np.sqrt(share), width=edges[1], align="edge", color=ROWS_COLOR, linewidth=0, zorder=0)
        densest = max(densest, float(share.max()))
    rings = [tick for tick in MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(0.0, densest) if 0.0 < tick <= densest]
    cuts = np.arange(22.5, 360.0, 45.0)
    free = cuts[np.argmin(np.interp(np.deg2rad(cuts), ANGLES, densities[0]))]  # with room for numbers
    axes.set_rgrids(np.sqrt(rings), [f"{ring:g}" for ring in rings], angle=free, fontsize=SMALL - 1)
    axes.set_rmax(1.04 * np.sqrt(densest))
    axes.set_thetagrids(np.arange(0, 360, 45), ["E", "45°", "N", "135°", "W", "-135°", "S", "-45°"])
    axes.set_xlabel("density [1/rad], areas to scale")
    dress(axes, "(a)  Directions")
    axes.grid(color=FAINT, linewidth=0.4)


def _draw_speeds(axes: Axes, place: Place, rows: Tracks | None) -> None:
    """Gammas of the modes; vehicles that stand have a share, but no curve: at 0 it would dwarf all others."""
    weight, gamma = place.direction.weight, place.speed
    far = [float(gamma.mean[mode] + 4.0 * np.sqrt(gamma.shape[mode]) / gamma.rate[mode]) for mode in place.shown]
    if rows is not None and len(rows):
        far.append(1.05 * float(rows.speed.max()))
    fastest = float(np.ceil(max([1.0, *far])))
    speed = np.linspace(0.0, fastest, 1001)[1:]
    parts = weight * np.exp(gamma.log_density(speed[:, None]))
    for mode in place.shown:
        axes.fill_between(speed, parts[:, mode], color=_color(place, mode), alpha=OPACITY, linewidth=0)
    moving = gamma.mean >= STANDING_SPEED
    total = parts[:, moving].sum(axis=-1)
    axes.plot(speed, total, color=INK, linewidth=1.2)
    tallest = float(total.max(initial=1e-6))
    if rows is not None and len(rows):
        counts, edges = np.histogram(rows.speed[rows.speed >= STANDING_SPEED], BINS_OF_SPEED, (0.0, fastest))
        share = counts / (len(rows) * edges[1])
        axes.stairs(share, edges, fill=True, color=ROWS_COLOR, zorder=0)
        tallest = max(tallest, float(share.max()))
    axes.set(xlim=(0.0, fastest), ylim=(0.0, 1.06 * tallest), ylabel="density [s/m]")
    axes.set_xlabel(f"speed [m/s]; standing, not drawn: {float(weight[~moving].sum()):.1%}")
    x, y = place.position
    dress(axes, f"(b)  Speeds at ({x:.1f}, {y:.1f}) m", is_open=True)
