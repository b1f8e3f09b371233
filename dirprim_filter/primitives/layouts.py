"""Layouts of cells to choose from: squares, even Voronoi cells, and cells learned together with the primitives.

The paper's section VI asks for the latter.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.cell_model import PrimitiveModel
from dirprim_filter.primitives.choice import with_usual
from dirprim_filter.primitives.recipe import Recipe
from dirprim_filter.primitives.rows import TrackRows
from tessellation import GridTessellation, Tessellation, VoronoiTessellation, fit_jointly

TRIAL_ROWS = 100_000
"""So many rows are enough to find out what is usual, and how strongly cells lean on it: vehicles drawn at random."""
SOFTNESS = 0.25
"""Of a Voronoi cell's size: so far beyond its border it also learns from rows beside it, see `tessellation.gates`.
Where .1 and .5 could be chosen too, the densities of two towns were the same."""

Progress = Callable[[int, float], None]


def layouts_of(
    rows: TrackRows, tessellation: str | Tessellation, recipe: Recipe, background: Background, *,
    cell_size: float | None, n_cells: int | None, progress: Progress | None, rng: np.random.Generator,
) -> list[Layout]:  # fmt: skip
    """The cells to choose from; joint ones are chosen as they are laid out."""
    position, config = rows.position, recipe.config
    if not isinstance(tessellation, str):
        return [Layout(tessellation, 0.0)]
    if tessellation == "grid":
        if n_cells is not None:
            return [Layout(_grid_of_about(position, n_cells), 0.0)]
        sizes = config.cell_sizes if cell_size is None else (cell_size,)
        return [Layout(GridTessellation.covering(position, cell_size=size), 0.0) for size in sizes]
    if cell_size is not None:
        n_cells = GridTessellation.covering(position, cell_size=cell_size).n_cells
    if tessellation == "voronoi":
        return _lay_out_evenly(rows, n_cells, config, rng=rng)
    return [_lay_out_jointly(rows, n_cells, recipe, background, progress=progress, rng=rng)]


def _lay_out_evenly(
    rows: TrackRows, n_cells: int | None, config: LearningConfig, *, rng: np.random.Generator
) -> list[Layout]:
    """Cells by positions alone."""
    numbers = [_even_cells(rows, each) for each in config.rows_per_cell] if n_cells is None else [n_cells]
    cells = [VoronoiTessellation.lloyd(rows.position, n_cells=n, rng=rng, reach=rows.scale.reach_m) for n in numbers]
    return [Layout(tessellation, SOFTNESS) for tessellation in cells]


def _even_cells(rows: TrackRows, rows_per_cell: float) -> int:
    """How many cells of so many rows each there are: a number that does not change when the data are moved."""
    return 1 + int(len(rows) / rows_per_cell)


def _lay_out_jointly(
    rows: TrackRows, n_cells: int | None, recipe: Recipe, background: Background, *, progress: Progress | None,
    rng: np.random.Generator,
) -> Layout:  # fmt: skip
    """Cells learned together with the primitives."""
    config = recipe.config
    few = rows.some(TRIAL_ROWS, rng=rng)
    n_even = _even_cells(few, config.rows_per_cell[0])
    even = VoronoiTessellation.lloyd(few.position, n_cells=n_even, rng=rng, reach=few.scale.reach_m)
    recipe = with_usual(few, Layout(even, SOFTNESS), recipe, background)
    model = PrimitiveModel.of(rows, recipe._replace(thorough=False), background)
    found = fit_jointly(
        model, rows.position, rows, group=rows.group, reach=rows.scale.reach_m, n_cells=n_cells, softness=SOFTNESS,
        progress=progress, rng=rng,
    )  # fmt: skip
    return Layout(found.tessellation, SOFTNESS)


def _grid_of_about(position: FloatArray, n_cells: int) -> GridTessellation:
    """The grid whose number of cells is nearest to `n_cells`, by bisection on the logarithm of its cell size."""
    low, high = 0.1, float(np.ptp(position, axis=0).max()) + 1.0
    if n_cells == 1:  # lines of a grid go through the origin, so around it there would be four
        return GridTessellation(
            origin=position.min(axis=0) - 0.5, cell_size=high, n_x=1, n_y=1, square=np.zeros(1, np.int64)
        )
    nearest = GridTessellation.covering(position, cell_size=high)
    for _ in range(30):
        middle = float(np.sqrt(low * high))
        grid = GridTessellation.covering(position, cell_size=middle)
        nearest = min(nearest, grid, key=lambda tried: abs(tried.n_cells - n_cells))
        if grid.n_cells == n_cells:
            break
        low, high = (middle, high) if grid.n_cells > n_cells else (low, middle)
    return nearest
