"""One place of a map: its directions (Eq. 1) and speeds (Eq. 3), by mode, and what a turn signal adds (Eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import Gamma, VonMisesMixture, von_mises
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color
from dirprim_filter.evaluation.turn_signal import clearest_choice
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import (
    DOTS_PER_INCH,
    LARGE,
    NORMAL,
    add_axes,
    add_polar_axes,
    dress_map,
    dress_polar,
    open_frame,
)
from dirprim_filter.viewer.layers import FOCUS_COLOR, INK, STANDING_SPEED, draw_map, draw_tracks
from tessellation import OUTSIDE
from tessellation.anchors import anchors

LEAST_WEIGHT = 0.01
"""Modes of less weight are not drawn by themselves."""
AROUND = 4.0
"""The surroundings of a place reach so many cells to each side."""
N_UNIFORM, STEPS = 721, np.linspace(-6.0, 6.0, 121)
"""Directions around the circle; and, in deviations of each mode, about it."""
BIN_DEG, BINS_OF_SPEED = 5, 30
OPACITY, ROWS_COLOR, CUE_COLOR = 0.45, "0.85", "#E69F00"
KEY_ROW = 0.18
"""Inches."""


class Mode(NamedTuple):
    """One thing that moving vehicles do at a place."""

    weight: float
    mean_direction: float
    concentration: float
    speed: Gamma

    @property
    def color(self) -> str:
        """That of its direction."""
        return "#" + direction_color(np.array(self.mean_direction))[:3].tobytes().hex()

    @property
    def label(self) -> str:
        """Its share, direction and speed."""
        spread = float(np.sqrt(self.speed.shape) / self.speed.rate)
        return f"{self.weight:.1%}: {np.rad2deg(self.mean_direction):+.0f}°, {self.speed.mean:.1f} ± {spread:.1f} m/s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place of a map that a cell covers, and a vehicle there that may signal.

    Attributes:
        primitives: the map.
        position: (2,) metres.
        cell: the cell there.
        heading: radians, of the vehicle.
    """

    primitives: PrimitiveMap
    position: FloatArray
    cell: int
    heading: float = 0.0

    @classmethod
    def at(
        cls, primitives: PrimitiveMap, position: npt.ArrayLike | None, *, cue: Cue | None, heading: float | None
    ) -> Self:
        """The place at a position (2,), metres; what is left out is taken where going on and turning are usual.

        Without a cue, or where nobody turns, it is the cell where most goes different ways, and the usual heading.

        Raises:
            ValueError: no cell is there, or none holds data.
        """
        rows, mean, cells = moving_rows(primitives), primitives.direction.mean_direction[:-1], primitives.tessellation
        turn = 0.0 if cue is None else float(np.asarray(cue.turn)[0])
        if position is None:
            if not (primitives.n_rows[:-1] > 0).any():
                raise ValueError("map: expected a cell that holds data, got none; learn it from a log with vehicles")
            choice = clearest_choice(mean, rows, turn) if turn and rows.any() else None
            spread = rows.sum(axis=-1) - np.hypot(
                (rows * np.cos(mean)).sum(axis=-1), (rows * np.sin(mean)).sum(axis=-1)
            )
            cell = choice.place if choice is not None and choice.weight > 0 else int(np.argmax(spread))
            place = anchors(cells)[cell]
        else:
            place = np.asarray(position, dtype=np.float64)
            cell = int(cells.cell_of(place))
            if cell == OUTSIDE:
                (west, south), (east, north) = shapes.map_extent(primitives)
                raise ValueError(
                    f"position: expected a place in a cell, got ({place[0]:g}, {place[1]:g}) m, outside of all "
                    f"{cells.n_cells}; they lie between ({west:.0f}, {south:.0f}) and ({east:.0f}, {north:.0f}) m"
                )
        if heading is None:
            here = primitives.primitive_at(place).direction.mean_direction
            choice = clearest_choice(here[None], rows[cell][None], turn) if turn else None
            usual = float(here[np.argmax(rows[cell])])
            heading = choice.heading if choice is not None and choice.weight > 0 else usual
        return cls(primitives=primitives, position=place, cell=cell, heading=heading)

    @property
    def direction(self) -> VonMisesMixture:
        """The mixture of directions that holds here, (M,)."""
        return self.primitives.primitive_at(self.position).direction

    @property
    def speed(self) -> Gamma:
        """The speeds of its modes, (M,)."""
        return self.primitives.primitive_at(self.position).speed

    def modes(self) -> list[Mode]:
        """The cell's own modes of vehicles that move, the most frequent first."""
        direction, speed = self.direction, self.speed
        weight = direction.weight[: self.primitives.n_own_modes]
        moves = moving_rows(self.primitives)[self.cell, : weight.size] > 0
        shown = np.flatnonzero(moves & (weight >= LEAST_WEIGHT))
        return [
            Mode(float(weight[m]), float(direction.mean_direction[m]), float(direction.concentration[m]), speed[int(m)])
            for m in shown[np.argsort(-weight[shown], kind="stable")]
        ]


def place_figure(
    primitives: PrimitiveMap, *, position: npt.ArrayLike | None = None, tracks: Tracks | None = None,
    cue: Cue | None = None, heading: float | None = None,
) -> Figure:  # fmt: skip
    """Directions and speeds at a place, by mode, and where it is.

    Args:
        primitives: the map.
        position: (2,) metres; left out: where going different ways is most usual.
        tracks: rows in the same cell, drawn as histograms.
        cue: a turn signal, drawn with its product with the prior (the paper's Fig. 8).
        heading: radians, of the vehicle that signals; left out, one from which turning and going on are usual.

    Raises:
        ValueError: no cell covers the position.
    """
    place = Place.at(primitives, position, cue=cue, heading=heading)
    modes = place.modes()
    rows = None if tracks is None else tracks[primitives.tessellation.cell_of(tracks.position) == place.cell]
    curves: list[tuple[str, VonMisesMixture, dict[str, Any]]] = [
        ("p(direction) and p(speed) at the place", place.direction, {"color": INK, "linewidth": 1.2})
    ]
    if cue is not None:
        signal = cue.belief(place.heading)
        posterior = multiply_mixtures(place.direction, signal).mixture
        curves.append(
            ("cue: the turn signal", signal, {"color": CUE_COLOR, "linewidth": 1.6, "linestyle": (0, (5, 2))})
        )
        curves.append(("posterior ∝ p(direction) × cue", posterior, {"color": FOCUS_COLOR, "linewidth": 1.6}))
    key: list[Artist] = [Line2D([], [], label=name, **style) for name, _, style in curves]
    key += [Patch(facecolor=mode.color, alpha=OPACITY, label=mode.label) for mode in modes]
    if rows is not None:
        key.append(Patch(color=ROWS_COLOR, label=f"the cell's {len(rows):,} rows"))
    bottom = 0.75 + KEY_ROW * -(-len(key) // 3)
    figure = Figure(figsize=(11.6, bottom + 3.0), dpi=DOTS_PER_INCH)
    figure.legend(handles=key, loc="lower center", ncols=3, frameon=False, fontsize=NORMAL, labelspacing=0.35)
    polar = add_polar_axes(figure, (0.55, bottom, 2.45, 2.45))
    _draw_directions(polar, modes, curves, rows)
    polar.set_title("(a)  Directions", loc="left", fontsize=LARGE, x=-0.15, y=1.1)
    speeds = add_axes(figure, (3.9, bottom, 4.4, 2.45))
    _draw_speeds(speeds, place, modes, rows)
    x, y = place.position
    speeds.set_title(f"(b)  Speeds at ({x:.1f}, {y:.1f}) m", loc="left", fontsize=LARGE)
    surroundings = add_axes(figure, (9.1, bottom, 2.3, 2.45))
    _draw_surroundings(surroundings, place, tracks, None if cue is None else float(signal.mean_direction[0]))
    surroundings.set_title("(c)  The place", loc="left", fontsize=LARGE)
    return figure


def _draw_directions(
    axes: PolarAxes, modes: list[Mode], curves: list[tuple[str, VonMisesMixture, dict[str, Any]]], rows: Tracks | None
) -> None:
    """Densities whose areas are to scale, r is their root."""
    theta = np.linspace(0.0, TWO_PI, N_UNIFORM)
    for _, mixture, _ in curves:
        spread = 1.0 / np.sqrt(np.maximum(mixture.concentration, 1.0))
        theta = np.append(theta, np.mod(mixture.mean_direction[:, None] + spread[:, None] * STEPS, TWO_PI))
    theta, densest = np.unique(theta), 0.0
    for mode in modes:
        mean, concentration = np.array(mode.mean_direction), np.array(mode.concentration)
        part = mode.weight * np.exp(von_mises.log_density(theta, mean, concentration))
        axes.fill_between(theta, np.sqrt(part), color=mode.color, alpha=OPACITY, linewidth=0)
    for _, mixture, style in curves:
        density = np.exp(mixture.log_density(theta))
        axes.plot(theta, np.sqrt(density), **style)
        densest = max(densest, float(density.max()))
    moving = None if rows is None else rows[rows.speed >= STANDING_SPEED]
    if moving is not None and len(moving):
        edges = np.deg2rad(np.arange(0, 361, BIN_DEG))
        share, _ = np.histogram(np.mod(moving.direction, TWO_PI), edges, density=True)
        axes.bar(edges[:-1], np.sqrt(share), width=edges[1], align="edge", color=ROWS_COLOR, linewidth=0, zorder=0)
        densest = max(densest, float(share.max()))
    cuts = np.deg2rad(np.arange(22.5, 360.0, 45.0))
    free = cuts[np.argmin(np.exp(curves[0][1].log_density(cuts)))]
    dress_polar(axes, densest=densest, free=float(free))


def _draw_speeds(axes: Axes, place: Place, modes: list[Mode], rows: Tracks | None) -> None:
    """Gammas of the modes; vehicles that stand have a share, but no curve: at 0 it would dwarf all others."""
    far = [float(mode.speed.mean + 4.0 * np.sqrt(mode.speed.shape) / mode.speed.rate) for mode in modes]
    fastest = float(
        np.ceil(max([1.0, *far, 1.05 * float(rows.speed.max()) if rows is not None and len(rows) else 0.0]))
    )
    speed = np.linspace(0.0, fastest, 1001)[1:]
    weight, gamma = place.direction.weight, place.speed
    moving = gamma.mean >= STANDING_SPEED
    total = (weight[moving] * np.exp(gamma[moving].log_density(speed[:, None]))).sum(axis=-1)
    for mode in modes:
        part = mode.weight * np.exp(mode.speed.log_density(speed))
        axes.fill_between(speed, part, color=mode.color, alpha=OPACITY, linewidth=0)
    axes.plot(speed, total, color=INK, linewidth=1.2)
    tallest = float(total.max(initial=1e-6))
    if rows is not None and len(rows):
        edges = np.linspace(0.0, fastest, BINS_OF_SPEED + 1)
        counts, _ = np.histogram(rows.speed[rows.speed >= STANDING_SPEED], edges)
        share = counts / (len(rows) * edges[1])
        axes.stairs(share, edges, fill=True, color=ROWS_COLOR, zorder=0)
        tallest = max(tallest, float(share.max()))
    standing = float(weight[~moving].sum())
    axes.set(xlabel=f"speed [m/s]; standing, not drawn: {standing:.1%}", ylabel="density [s/m]")
    axes.set(xlim=(0.0, fastest), ylim=(0.0, 1.06 * tallest))
    open_frame(axes)


def _draw_surroundings(axes: Axes, place: Place, tracks: Tracks | None, turn: float | None) -> None:
    """The place and what is around it; where a vehicle signals, its way to the place and where the signal points."""
    cells = place.primitives.tessellation
    draw_map(axes, place.primitives, opacity=0.5)
    if tracks is not None:
        draw_tracks(axes, tracks)
    axes.plot(*shapes.cell_outlines(cells)[place.cell].T, color=FOCUS_COLOR, linewidth=1.4, zorder=8)
    axes.plot(*place.position, "+", color=FOCUS_COLOR, markersize=6, markeredgewidth=1.2, zorder=9)
    half = AROUND * np.sqrt(cells.area[place.cell])
    dress_map(axes, place.position + half * np.array([[-1.0], [1.0]]))
    if turn is None:
        return
    ahead, aside = (0.6 * half * np.array([np.cos(of), np.sin(of)]) for of in (place.heading, turn))
    here = place.position
    for start, end, color in ((here - ahead, here, INK), (here, here + aside, CUE_COLOR)):
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 3}
        axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=10)


def moving_rows(primitives: PrimitiveMap) -> FloatArray:
    """How many rows each cell's own modes of moving vehicles stand for; 0 for all other modes. -> (n_cells, M)."""
    weight = np.zeros_like(primitives.direction.weight[:-1])
    weight[:, : primitives.n_own_modes] = primitives.own_weight
    return np.asarray(primitives.n_rows[:-1, None] * weight * (primitives.speed.mean[:-1] >= STANDING_SPEED))
