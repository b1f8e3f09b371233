"""All cells fitted at once, on as many cores as there are."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _kernels
from dirprim_filter.primitives._modes import (
    COSINE,
    EAST,
    LOG_SPEED,
    N_COLUMNS,
    NORTH,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
    empty_table,
)
from dirprim_filter.primitives.rows import CellRows
from dirprim_filter.primitives.two_steps import fit_in_two_steps

MIN_STANDING_MEAN = 0.05
"""m/s; standing vehicles of a simulator have speed 0, which would make the density at 0 unbounded."""
MIN_SPREAD = 1e-3
"""Of log speeds, log(mean) - mean(log): a log of one speed does not say that all others are as like."""

MOST_ROWS = 16_384
"""Of a cell: of more every second, third, ... is fitted, for rows of a vehicle stand together and repeat each other."""
TOLERANCE = 1e-7
"""Of the objective per vehicle."""
ROUGH: dict[str, Any] = {"thorough": False, "tolerance": 1e-3, "parameter_cost": 1.0}
"""Of bounds, while cells are looked for: such fits are compared, not kept, and cells of fewer modes last."""
SHARE = 8192
"""Threads take cells of so many rows at a time: few enough to level out what cells cost, and a thread is worth it."""
ROWS_OF_A_CELL = 32
"""A cell costs as many rows do, beside its own."""


def bounds_of(
    config: LearningConfig,
    *,
    prior_strength: float,
    max_modes: int | None = None,
    usual_resultant: float = 0.0,
    speed_spread: float = 1.0,
    curved: bool = False,
    parameter_cost: float = 1.0,
) -> Bounds:
    """The priors and bounds of a fit, as the kernels take them."""
    return Bounds(
        config.max_modes if max_modes is None else max_modes, prior_strength, usual_resultant, speed_spread,
        config.max_concentration, config.max_shape, config.dbscan_eps, config.dbscan_share,
        config.bend_scale, config.gain_scale, curved, parameter_cost,
        TOLERANCE, True, config.standing_speed,
    )  # fmt: skip


def fit_all(in_cells: CellRows, bounds: Bounds, *, n_threads: int | None = None) -> FloatArray:
    """Fit every cell's modes to its rows; threads divide the cells, so their number changes nothing.

    Args:
        in_cells: the rows of each cell.
        bounds: priors and bounds; `with_speed`: direction and speed together and modes by BIC, or else the paper's two
            steps.
        n_threads: as many as there are cores if absent.

    Returns:
        (n_cells, max_modes, N_CURVED) a table of modes, see `_modes`; none where a cell has no rows or fewer modes.
    """
    at_once = bounds.with_speed
    bounds = bounds._replace(curved=at_once and bounds.curved)
    columns, start = columns_of(in_cells)
    fitted = np.diff(start)  # of a large cell fewer rows, which are not of more vehicles
    n_vehicles = np.where(fitted < MOST_ROWS // 2, in_cells.n_vehicles, np.minimum(in_cells.n_vehicles, fitted))
    n_cells = in_cells.n_vehicles.size
    table = empty_table(n_cells, bounds.max_modes)

    cost = start + ROWS_OF_A_CELL * np.arange(n_cells + 1)
    bound = np.unique(np.append(np.searchsorted(cost, np.arange(0, cost[-1], SHARE)), n_cells))

    def fit_share(i: int) -> None:
        if at_once:
            _kernels.fit_cells_at_once(columns, start, n_vehicles, bounds, bound[i], bound[i + 1], table)
            return
        for c in range(bound[i], bound[i + 1]):
            rows = np.ascontiguousarray(columns[:, start[c] : start[c + 1]])
            fit_in_two_steps(rows, float(n_vehicles[c]), bounds, table[c])

    if bound.size > 2:
        with ThreadPoolExecutor(n_threads or os.cpu_count()) as pool:
            list(pool.map(fit_share, range(bound.size - 1)))
    elif bound.size > 1:
        fit_share(0)
    return table


def columns_of(in_cells: CellRows) -> tuple[FloatArray, IntArray]:
    """A column for each member that is fitted, sorted by cell: (N_COLUMNS, n), and where each cell's begin."""
    n_members = np.diff(in_cells.start)
    cell, number = np.repeat(np.arange(n_members.size), n_members), np.arange(in_cells.row.size)
    stride = 1 + n_members // MOST_ROWS
    meant = (in_cells.weight > 0.0) & ((number - in_cells.start[cell]) % stride[cell] == 0)
    cell, row = cell[meant], in_cells.row[meant]
    start = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=n_members.size))])
    used, index = (slice(None), row) if row.size > in_cells.speed.size else (row, slice(None))  # what costs less
    direction, speed = in_cells.direction[used], np.maximum(in_cells.speed[used], 1e-300)
    columns = np.empty((N_COLUMNS, row.size))
    columns[COSINE], columns[SINE] = np.cos(direction)[index], np.sin(direction)[index]
    columns[SPEED], columns[LOG_SPEED] = speed[index], np.log(speed)[index]
    columns[WEIGHT] = in_cells.weight[meant]
    columns[EAST], columns[NORTH] = (in_cells.position[row] - in_cells.center[cell]).T
    return columns, start
