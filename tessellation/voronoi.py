"""Voronoi cells: a position belongs to its nearest generator, where there are data nearby.

Generators may be the means of the positions nearest to them: k-means in the plane (Lloyd 1982).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tessellation._arrays import FloatArray, IntArray, as_floats, as_places
from tessellation._kernels import Locator
from tessellation.gates import nearest_generators
from tessellation.grid import GridTessellation
from tessellation.locate import cells_of, voronoi_locator
from tessellation.outlines import Outlines, outlines

MAX_CELLS = 20_000_000
NEAREST_M = 1e-9
"""Generators are farther apart."""
MAX_STEPS = 100
LEAST_GAIN = 1e-4
"""Of the squared distances; a step that lowers them by less is the last."""
SAME_M = 1e-6
"""Positions as near to each other are one: parked vehicles jitter by rounding."""
MOST_DISTANCES = 500_000_000
"""From positions to seeds: of more, seeds are chosen among every second, third, ... position."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VoronoiTessellation:
    """The nearest generator's cell for positions in a region; `OUTSIDE` beyond it.

    Attributes:
        generators: (n_cells, 2) metres, no two the same. Of several that are equally near, the first has the position.
        region: squares near the data. Where they do not reach, no cell does.

    Raises:
        ValueError: generators of another shape, not within `FARTHEST_M`, or twice the same.
    """

    generators: FloatArray
    region: GridTessellation
    locator: Locator = field(init=False, repr=False, compare=False)
    _outlines: list[Outlines] = field(init=False, repr=False, compare=False, default_factory=list)

    def __post_init__(self) -> None:
        generators = as_places("generators", self.generators, "n 2")
        if len(generators) > MAX_CELLS:
            raise ValueError(f"generators: expected at most {MAX_CELLS}, got {len(generators)}")
        if len(generators) > 1:
            distance, near = nearest_generators(generators, generators, k=2)
            again = np.flatnonzero(distance[:, 1] < NEAREST_M)
            if again.size:
                one, two = sorted((int(again[0]), int(near[again[0]][near[again[0]] != again[0]][0])))
                x, y = generators[one]
                raise ValueError(
                    f"generators: expected each once, got ({x}, {y}) as number {one} and {two}, nearer to each other "
                    f"than {NEAREST_M:g} m; {again.size} have another so near: leave these out"
                )
        object.__setattr__(self, "generators", generators)
        object.__setattr__(self, "locator", voronoi_locator(generators, self.region.locator))

    @classmethod
    def covering(cls, position: FloatArray, *, generators: FloatArray, reach: float) -> VoronoiTessellation:
        """Cells that cover all within `reach` of the positions, and nothing farther than 2 sqrt(2) `reach`.

        The region is made of the squares of side `reach` that hold a position, and of their eight neighbours.

        Args:
            position: (n, 2) metres, n >= 1.
            generators: (n_cells, 2) metres; all are kept, those that own nothing of the region too.
            reach: metres.

        Raises:
            ValueError: no position, a reach that is not positive, or an extent too large for it; generators that the
                class refuses.
        """
        return cls(generators=generators, region=_region(position, reach))

    @classmethod
    def lloyd(
        cls, position: FloatArray, *, n_cells: int, rng: np.random.Generator, reach: float
    ) -> VoronoiTessellation:
        """Cells around the means of the positions in them: a k-means++ start, then Lloyd's iterations.

        Args:
            position: (n, 2) metres, n >= 1.
            n_cells: at most so many cells; fewer if there are fewer distinct positions.
            rng: chooses the start.
            reach: of the cells around the positions, metres: see `covering`.

        Raises:
            ValueError: no position, or arguments out of range.
        """
        position = as_floats("position", position, "n 2")
        return cls(region=_region(position, reach), generators=lloyd_generators(position, rng.random(n_cells)))

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.generators)

    @property
    def centers(self) -> FloatArray:
        """(n_cells, 2) the generators, metres."""
        return self.generators

    @property
    def area(self) -> FloatArray:
        """(n_cells,) the areas of the polygons, square metres; 0 for a cell that owns nothing of the region."""
        return self._drawn().area

    def cell_of(self, position: FloatArray) -> IntArray:
        """The cell of each position; `OUTSIDE` where no cell covers it. (..., 2) -> (...).

        Raises:
            ValueError: the last axis is not 2, or a coordinate is not finite.
        """
        position = as_floats("position", position, "... 2")
        return cells_of(self.locator, position.reshape(-1, 2)).reshape(position.shape[:-1])

    def polygons(self) -> list[FloatArray]:
        """One convex (k, 2) polygon for each cell, counter-clockwise, not closed; k = 0 where it owns no region.

        It is the Voronoi polygon, clipped to a box around what the cell owns of the region. So
        every position lies in the polygon of its cell, and polygons do not overlap; they may cover a part of squares
        that are not in the region.
        """
        drawn = self._drawn()
        return np.split(drawn.vertex, drawn.start[1:-1]) if self.n_cells else []

    def _drawn(self) -> Outlines:
        """The polygons, made when first asked for."""
        if not self._outlines:
            self._outlines.append(outlines(self.generators, self.locator))
        return self._outlines[0]


def _region(position: FloatArray, reach: float) -> GridTessellation:
    """The squares of side `reach` that hold a position, and their neighbours."""
    if not (np.isfinite(reach) and reach > 0):
        raise ValueError(f"reach: expected a positive length in metres, got {reach}")
    held = GridTessellation.covering(position, cell_size=reach)
    row, column = np.divmod(held.square, held.n_x)
    n_x = held.n_x + 2
    near = [(row + i) * n_x + column + j for i in range(3) for j in range(3)]
    return GridTessellation(
        origin=held.origin - reach, cell_size=reach, n_x=n_x, n_y=held.n_y + 2, square=np.unique(np.concatenate(near))
    )


def lloyd_generators(position: FloatArray, uniform: FloatArray) -> FloatArray:
    """Generators by k-means: seeds far from each other, then means of the nearest positions. -> (at most k, 2).

    The order of the positions does not matter, nor where they are or which way they are turned; a position given twice
    counts as one of twice the weight.

    Args:
        position: (n, 2) metres, n >= 1.
        uniform: (k,) random numbers in [0, 1), which choose the seeds; fewer if there are fewer distinct positions.

    Raises:
        ValueError: no cell is asked for.
    """
    if uniform.size < 1:
        raise ValueError(f"n_cells: expected at least 1, got {uniform.size}")
    position, weight = _distinct(position)
    n, k = len(position), min(len(position), uniform.size)
    stride = min(1 + n * k // MOST_DISTANCES, n // k)  # seeds are drawn from so many fewer, yet from no fewer than k
    generators = position[::stride][seeds(position[::stride], weight[::stride], uniform)]
    before = np.inf
    for _ in range(MAX_STEPS):
        cell = nearest_generators(position, generators, k=1)[1][:, 0]
        off, n = (position - generators[cell]).T, len(generators)
        spread = float(weight @ (off[0] * off[0] + off[1] * off[1]))
        if spread >= before * (1.0 - LEAST_GAIN):
            break
        total = np.bincount(cell, weight, n)
        moved = np.column_stack([np.bincount(cell, weight * along, n) for along in off])
        generators, before = generators + moved / np.where(total > 0, total, 1.0)[:, None], spread
    cell = nearest_generators(position, generators, k=1)[1][:, 0]
    generators = generators[np.bincount(cell, minlength=len(generators)) > 0]
    return generators[np.lexsort(generators.T)]


def seeds(position: FloatArray, weight: FloatArray, uniform: FloatArray) -> IntArray:
    """k-means++ (Arthur and Vassilvitskii 2007): each is drawn by weight times squared distance to those before.

    Args:
        position: (n, 2) metres.
        weight: (n,) positive.
        uniform: (k,) random numbers in [0, 1).

    Returns:
        Row numbers, at most (k,): fewer where all others are of one place with them.
    """
    chosen: list[int] = []
    squared = np.ones(weight.size)
    x, y = np.ascontiguousarray(position.T)
    for u in uniform.tolist():
        cumulative = np.cumsum(weight * squared)
        if not cumulative[-1] > 0.0:
            break
        at = int(np.searchsorted(cumulative, u * cumulative[-1], side="right"))
        away = (x - x[at]) ** 2 + (y - y[at]) ** 2
        squared = np.minimum(squared, away) if chosen else away
        chosen.append(at)
    return np.array(chosen, dtype=np.int64)


def _distinct(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distinct positions, along their principal axes, each towards its longer tail, and how often each is given.

    So they come in the same order however they were turned.
    """
    offset = position - position[0]
    offset -= offset.mean(axis=0)
    along = offset @ np.linalg.eigh(offset.T @ offset)[1]
    along = along * np.where((along**3).sum(axis=0) < 0, -1.0, 1.0)
    position = position[np.lexsort(along.T)]
    new = np.flatnonzero(np.append(True, (np.abs(np.diff(position, axis=0)) > SAME_M).any(axis=1)))
    return position[new], np.diff(np.append(new, len(position))).astype(np.float64)
