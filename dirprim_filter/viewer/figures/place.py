"""One place of a map: the primitive that holds there, its modes, and where it lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.page import SMALL, dress_map
from dirprim_filter.viewer.layers import FOCUS_COLOR, STANDING_SPEED, draw_map, draw_tracks
from tessellation import OUTSIDE
from tessellation.anchors import anchors

LEAST_WEIGHT = 0.01
"""Modes of less weight are summed up as the rest."""

AROUND = 4.0
"""The surroundings of a place reach so many cells to each side."""
LineStyle = Literal["-"] | tuple[float, tuple[float, ...]]
DASHES: tuple[LineStyle, ...] = ("-", (0, (4, 2)), (0, (1, 1)), (0, (6, 1, 1, 1)))
N_UNIFORM = 721
"""Directions around a circle, where no mode asks for more."""


class Mode(NamedTuple):
    """One thing that vehicles do at a place."""

    number: int
    weight: float
    mean_direction: float
    concentration: float
    speed: Gamma

    @property
    def color(self) -> str:
        """That of its direction."""
        return "#" + direction_color(np.array(self.mean_direction))[:3].tobytes().hex()

    @property
    def dashes(self) -> LineStyle:
        """Of its outline, so that modes of one direction differ."""
        return DASHES[(self.number - 1) % len(DASHES)]

    @property
    def degrees(self) -> str:
        """Its direction as text."""
        return f"{np.rad2deg(self.mean_direction):+.0f}°"


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place of a map that a cell covers.

    Attributes:
        primitives: the map.
        position: (2,) metres.
        cell: the cell there.
    """

    primitives: PrimitiveMap
    position: FloatArray
    cell: int

    @classmethod
    def at(cls, primitives: PrimitiveMap, position: npt.ArrayLike | None) -> Self:
        """The place at a position (2,), metres; left out, the centre of the cell where most goes different ways.

        That is the greatest number of rows times the circular variance of the modes in which vehicles move.

        Raises:
            ValueError: no cell is there, or none holds data.
        """
        tessellation = primitives.tessellation
        if position is None:
            if not (primitives.n_rows[:-1] > 0).any():
                raise ValueError("map: expected a cell that holds data, got none; learn it from a log with vehicles")
            rows = moving_rows(primitives)
            mean = primitives.direction.mean_direction[:-1]
            total, east, north = (
                rows.sum(axis=-1),
                (rows * np.cos(mean)).sum(axis=-1),
                (rows * np.sin(mean)).sum(axis=-1),
            )
            cell = int(np.argmax(total - np.hypot(east, north)))
            return cls(primitives=primitives, position=anchors(tessellation)[cell], cell=cell)
        place = np.asarray(position, dtype=np.float64)
        cell = int(tessellation.cell_of(place))
        if cell == OUTSIDE:
            x, y = place
            (west, south), (east, north) = shapes.cell_extent(tessellation)
            raise ValueError(
                f"position: expected a place in a cell, got ({x:g}, {y:g}) m, outside of all {tessellation.n_cells} "
                f"cells; they lie between ({west:.0f}, {south:.0f}) and ({east:.0f}, {north:.0f}) m"
            )
        return cls(primitives=primitives, position=place, cell=cell)

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
        direction, speed, weight = self.direction, self.speed, self.primitives.own_weight[self.cell]
        moves = moving_rows(self.primitives)[self.cell, : weight.size] > 0
        shown = np.flatnonzero(moves & (weight >= LEAST_WEIGHT))
        order = shown[np.argsort(-weight[shown], kind="stable")]
        return [
            Mode(
                number=number,
                weight=float(weight[m]),
                mean_direction=float(direction.mean_direction[m]),
                concentration=float(direction.concentration[m]),
                speed=speed[int(m)],
            )
            for number, m in enumerate(order, start=1)
        ]

    def standing(self) -> float:
        """The weight of the modes in which vehicles stand."""
        return float(self.direction.weight[self.speed.mean < STANDING_SPEED].sum())

    def rows_of(self, tracks: Tracks) -> Tracks:
        """The rows in the place's cell."""
        return tracks[self.primitives.tessellation.cell_of(tracks.position) == self.cell]

    def draw(self, axes: Axes, tracks: Tracks | None = None) -> None:
        """The place and what is around it, on the map."""
        tessellation = self.primitives.tessellation
        draw_map(axes, self.primitives, opacity=0.5)
        if tracks is not None:
            draw_tracks(axes, tracks)
        outline = shapes.cell_outlines(tessellation)[self.cell]
        axes.plot(*outline.T, color=FOCUS_COLOR, linewidth=1.4, zorder=8)
        axes.plot(*self.position, "+", color=FOCUS_COLOR, markersize=6, markeredgewidth=1.2, zorder=9)
        half = AROUND * np.sqrt(tessellation.area[self.cell])
        dress_map(axes, self.position + half * np.array([[-1.0], [1.0]]))
        axes.tick_params(labelsize=SMALL - 1)

    @property
    def title(self) -> str:
        """Where it is."""
        x, y = self.position
        return f"({x:.1f}, {y:.1f}) m"


class Circle(NamedTuple):
    """Once around: directions from the one where a curve is cut open, dense where it is sharp.

    Attributes:
        theta: (n,) radians, ascending, from `start` to `start` + 2 pi.
        start: radians, a multiple of 45 degrees.
    """

    theta: FloatArray
    start: float

    @classmethod
    def around(cls, *mixtures: VonMisesMixture) -> Self:
        """The circle on which mixtures (M,) are drawn true: cut where together they are least dense."""
        cuts = np.deg2rad(np.arange(-180, 180, 45))
        near_cuts = cuts + np.deg2rad(np.arange(-15, 16, 3))[:, None]
        density = sum(np.exp(mixture.log_density(near_cuts)).max(axis=0) for mixture in mixtures)
        start = float(cuts[np.argmin(density)])
        steps = np.linspace(-6.0, 6.0, 121)
        theta = [np.linspace(0.0, TWO_PI, N_UNIFORM)]
        for mixture in mixtures:
            spread = 1.0 / np.sqrt(np.maximum(mixture.concentration, 1.0))
            near = (mixture.mean_direction[:, None] + spread[:, None] * steps).ravel()
            theta.append(np.mod(near - start, TWO_PI))
        return cls(start + np.unique(np.concatenate(theta)), start)

    @property
    def degrees(self) -> FloatArray:
        """(n,) the directions for an axis."""
        return np.rad2deg(self.theta)

    def degrees_of(self, direction: FloatArray) -> FloatArray:
        """Directions (n,), radians, on the axis of `degrees`."""
        return np.asarray(np.rad2deg(self.start + np.mod(direction - self.start, TWO_PI)))


def moving_rows(primitives: PrimitiveMap) -> FloatArray:
    """How many rows each cell's own modes of moving vehicles stand for; 0 for all other modes. -> (n_cells, M)."""
    weight = np.zeros_like(primitives.direction.weight[:-1])
    weight[:, : primitives.n_own_modes] = primitives.own_weight
    return np.asarray(primitives.n_rows[:-1, None] * weight * (primitives.speed.mean[:-1] >= STANDING_SPEED))
