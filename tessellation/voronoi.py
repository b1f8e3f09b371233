"""Voronoi cells: a position belongs to its nearest generator, where there are data nearby."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tessellation._arrays import FloatArray, IntArray, as_floats, as_places
from tessellation._kernels import Locator
from tessellation.gates import nearest_generators
from tessellation.grid import GridTessellation
from tessellation.lloyd import lloyd_generators
from tessellation.locate import cells_of, voronoi_locator
from tessellation.outlines import Outlines, outlines

MAX_CELLS = 20_000_000
NEAREST_M = 1e-9
"""Generators are farther apart."""


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
        return cls(region=_region(position, reach), generators=lloyd_generators(position, n_cells=n_cells, rng=rng))

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
