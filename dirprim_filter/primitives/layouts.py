"""The layout of cells: squares, even Voronoi cells, or cells learned together with the primitives.

The paper's section VI asks for the latter.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives._modes import Bounds
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.cell_model import Layout, PrimitiveModel, assemble, fit_cells, with_usual
from dirprim_filter.primitives.fitting import ROUGH
from dirprim_filter.primitives.rows import TrackRows
from tessellation import GridTessellation, Tessellation, VoronoiTessellation, fit_jointly

TRIAL_ROWS = 100_000
"""So many rows are enough to find out what is usual, and which cells are likeliest: vehicles drawn at random."""
SOFTNESS = 0.25
"""Of a Voronoi cell's size: so far beyond its border it also learns from rows beside it, see `tessellation.gates`.
Where .1 and .5 could be chosen too, the densities of two towns were the same."""
MANY_GROUPS = 200
"""From so many groups or vehicles on one third is held out once; of fewer, each third in turn."""
WEAK = 0.002
"""Pseudo-vehicles that lean on nothing, while it is found out what is usual."""

Progress = Callable[[int, float], None]


def lay_out(
    rows: TrackRows, tessellation: str | Tessellation, bounds: Bounds, background: Background, config: LearningConfig,
    *, cell_size: float | None, n_cells: int | None, progress: Progress | None, rng: np.random.Generator,
) -> Layout:  # fmt: skip
    """The cells: those given, those learned, or the likeliest of several sizes."""
    position, reach = rows.position, rows.scale.reach_m
    if not isinstance(tessellation, str):
        return Layout(tessellation, 0.0)
    if tessellation == "grid":
        if n_cells is not None:
            return Layout(_grid_of_about(position, n_cells), 0.0)
        sizes = config.cell_sizes if cell_size is None else (cell_size,)
        grids = [Layout(GridTessellation.covering(position, cell_size=size), 0.0) for size in sizes]
        return _likeliest(rows, grids, bounds, background, config, rng=rng)
    if cell_size is not None:
        n_cells = GridTessellation.covering(position, cell_size=cell_size).n_cells
    if tessellation == "voronoi":
        numbers = [_even_cells(rows, each) for each in config.rows_per_cell] if n_cells is None else [n_cells]
        even = [VoronoiTessellation.lloyd(position, n_cells=n, rng=rng, reach=reach) for n in numbers]
        return _likeliest(rows, [Layout(cells, SOFTNESS) for cells in even], bounds, background, config, rng=rng)
    few = rows.some(TRIAL_ROWS, rng=rng)
    n_even = _even_cells(few, config.rows_per_cell[0])
    even_cells = VoronoiTessellation.lloyd(few.position, n_cells=n_even, rng=rng, reach=reach)
    rough = leaning(few, Layout(even_cells, SOFTNESS), bounds, background)._replace(**ROUGH)
    found = fit_jointly(
        PrimitiveModel.of(rows, rough, background, config.background_vehicles), position, rows, group=rows.group,
        reach=reach, n_cells=n_cells, softness=SOFTNESS, progress=progress, rng=rng,
    )  # fmt: skip
    return Layout(found.tessellation, SOFTNESS)


def leaning(rows: TrackRows, layout: Layout, bounds: Bounds, background: Background) -> Bounds:
    """Bounds whose modes lean on what is usual in these cells."""
    alone = bounds._replace(prior_strength=WEAK, usual_resultant=0.0, speed_spread=background.speed_spread)
    usual = with_usual(fit_cells(rows, layout, alone._replace(**ROUGH)), alone)
    return usual._replace(prior_strength=bounds.prior_strength)


def _likeliest(
    rows: TrackRows, candidates: list[Layout], bounds: Bounds, background: Background, config: LearningConfig, *,
    rng: np.random.Generator,
) -> Layout:  # fmt: skip
    """The layout in which vehicles are likeliest that were held out from it; the last where none can be."""
    few = rows.some(TRIAL_ROWS, rng=rng)
    groups = np.unique(few.group)
    if len(candidates) == 1 or groups.size < 2:
        return candidates[-1]
    thirds = np.array_split(rng.permutation(groups), min(3, groups.size))
    masks = [np.isin(few.group, third) for third in thirds[: 1 if groups.size >= MANY_GROUPS else None]]

    def score(layout: Layout) -> float:
        rough = leaning(few, layout, bounds, background)._replace(**ROUGH)
        scores = []
        for mask in masks:
            made = assemble(layout.cells, fit_cells(few[~mask], layout, rough), background, config)
            kept = few[mask]
            log_p = made.log_density(kept.position, kept.direction, kept.speed)
            scores.append(np.average(log_p, weights=kept.weight))
        return float(np.mean(scores))

    return max(candidates, key=score)


def _even_cells(rows: TrackRows, rows_per_cell: float) -> int:
    """How many cells of so many rows each there are: a number that does not change when the data are moved."""
    return 1 + int(len(rows) / rows_per_cell)


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
