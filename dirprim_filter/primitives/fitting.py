"""All cells fitted at once, on as many cores as there are."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _ascent, _kernels, _merging
from dirprim_filter.primitives._modes import (
    COSINE,
    EAST,
    LOG_SPEED,
    LOG_WEIGHT,
    N_COLUMNS,
    N_FLAT,
    NO_MODE,
    NORTH,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
    Modes,
    empty_table,
)
from dirprim_filter.primitives.rows import CellRows
from dirprim_filter.primitives.two_steps import fit_in_two_steps

MIN_STANDING_MEAN = 0.05
"""m/s; standing vehicles of a simulator have speed 0, which would make the density at 0 unbounded."""
MIN_SPREAD = 1e-3
"""Of log speeds, log(mean) - mean(log): a log of one speed does not say that all others are as like."""

BINS = (96, 8, 1)
"""Of direction, log speed, and each axis of the place, when rows are merged."""
FINE_BINS = (256, 12, 1)
FINE_FROM = 200_000
"""So many rows say more than the wider bins leave of them: these bias a concentration by 1 %, these rows by less."""
CURVED_BINS = (64, 6, 8)
KEPT_ROWS = 256
"""So many rows a cell may have before they are merged: more than there are bins in use."""
CURVED_KEPT_ROWS = 8192
WORTH_MERGING = 200_000
"""So many rows of such cells there must be: compiling what merges takes as long as fitting fewer without."""
FINISHING_ITERATIONS = 10
TOLERANCE = 1e-7
"""Of the objective per vehicle."""
ROUGH_TOLERANCE = 1e-3
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
    thorough: bool = True,
) -> Bounds:
    """The priors and bounds of a fit, as the kernels take them."""
    return Bounds(
        config.max_modes if max_modes is None else max_modes, prior_strength, usual_resultant, speed_spread,
        config.max_concentration, config.max_shape, config.dbscan_eps, config.dbscan_share,
        config.bend_scale, config.gain_scale, curved, parameter_cost,
        TOLERANCE if thorough else ROUGH_TOLERANCE, thorough,
    )  # fmt: skip


def fit_all(
    in_cells: CellRows,
    bounds: Bounds,
    *,
    at_once: bool,
    near: Modes | None = None,
    worth_merging: int = WORTH_MERGING,
    n_threads: int | None = None,
) -> Modes:
    """Fit every cell's modes to its rows; threads divide the cells, so their number changes nothing.

    Args:
        in_cells: the rows of each cell.
        bounds: priors and bounds.
        at_once: direction and speed together and modes by BIC, or else the paper's two steps.
        near: (n_cells, max_modes) modes of nearly the same rows: with `at_once` cells that have any keep their number,
            and climb from there.
        worth_merging: rows that large cells must have together before any are merged.
        n_threads: as many as there are cores if absent.

    Returns:
        (n_cells, max_modes) each; of weight 0 where a cell has no rows or fewer modes.
    """
    bounds = bounds._replace(with_speed=at_once, curved=at_once and bounds.curved)
    merged = to_merge(in_cells, bounds, worth_merging) if at_once else np.zeros(in_cells.n_vehicles.size, np.bool_)
    columns, start = columns_of(in_cells, bounds, merged)
    n_cells = in_cells.n_vehicles.size
    table = empty_table(n_cells, bounds.max_modes) if near is None or not at_once else near.table()

    cost = start + ROWS_OF_A_CELL * np.arange(n_cells + 1)
    bound = np.unique(np.append(np.searchsorted(cost, np.arange(0, cost[-1], SHARE)), n_cells))

    def fit_share(i: int) -> None:
        if at_once:
            _kernels.fit_cells_at_once(columns, start, in_cells.n_vehicles, bounds, bound[i], bound[i + 1], table)
            return
        for c in range(bound[i], bound[i + 1]):
            rows = np.ascontiguousarray(columns[:, start[c] : start[c + 1]])
            fit_in_two_steps(rows, float(in_cells.n_vehicles[c]), bounds, table[c])

    def finish(i: int) -> None:
        _finish(in_cells, i, bounds, table[i])

    for work, items in ((fit_share, np.arange(bound.size - 1)), (finish, np.flatnonzero(merged & bounds.curved))):
        if items.size > 1:
            with ThreadPoolExecutor(n_threads or os.cpu_count()) as pool:
                list(pool.map(work, items.tolist()))
        else:
            for item in items.tolist():
                work(item)
    return Modes.of(table, bounds)


def _finish(in_cells: CellRows, c: int, bounds: Bounds, table: FloatArray) -> None:
    """Some iterations on the rows themselves: merged, they blur what bends by some thousandths of a nat."""
    columns, _ = _unmerged(in_cells.alone(c))
    k = int((table[:, LOG_WEIGHT] > NO_MODE / 2).sum())
    order = np.argsort(-table[:, LOG_WEIGHT], kind="stable")
    table[:] = table[order]
    _ascent.ascend(
        columns, 0, columns.shape[1], float(in_cells.n_vehicles[c]), bool(table[:k, N_FLAT:].any()), -np.inf, 0.0,
        bounds._replace(max_iterations=FINISHING_ITERATIONS), table[:k],
    )  # fmt: skip


def to_merge(in_cells: CellRows, bounds: Bounds, worth_merging: int = WORTH_MERGING) -> BoolArray:
    """(n_cells,) which cells have so many rows that they had better be merged."""
    n_members = np.diff(in_cells.start)
    large = n_members > (CURVED_KEPT_ROWS if bounds.curved else KEPT_ROWS)
    return np.asarray(large & (n_members[large].sum() > worth_merging))


def columns_of(in_cells: CellRows, bounds: Bounds, merged: BoolArray) -> tuple[FloatArray, IntArray]:
    """What stands for the rows of each cell: every row for itself, or those merged that lie together.

    Returns:
        (N_COLUMNS, n) columns sorted by cell, and (n_cells + 1,) where those of each cell begin.
    """
    if not merged.any():
        return _unmerged(in_cells)
    few, few_start = _unmerged(in_cells, ~merged) if not merged.all() else (np.empty((N_COLUMNS, 0)), in_cells.start)
    parts: list[FloatArray] = []
    for c in range(merged.size):
        if merged[c]:
            n = in_cells.start[c + 1] - in_cells.start[c]
            bins = CURVED_BINS if bounds.curved else FINE_BINS if n >= FINE_FROM else BINS
            room = np.empty((N_COLUMNS, bins[0] * bins[1] * bins[2] ** 2))
            end = _merging.merge(
                in_cells.direction, in_cells.speed, in_cells.position, in_cells.weight, in_cells.row,
                in_cells.start[c], in_cells.start[c + 1], in_cells.center[c], *bins, room, 0,
            )  # fmt: skip
            parts.append(room[:, :end].copy() if merged.size > 1 else room[:, :end])
        else:
            parts.append(few[:, few_start[c] : few_start[c + 1]])
    start = np.concatenate([[0], np.cumsum([part.shape[1] for part in parts])])
    return np.concatenate(parts, axis=1), start


def _unmerged(in_cells: CellRows, of_cells: BoolArray | None = None) -> tuple[FloatArray, IntArray]:
    """A column for each member of positive weight of the cells that are asked for."""
    n_members = np.diff(in_cells.start)
    cell = np.repeat(np.arange(n_members.size), n_members)
    meant = in_cells.weight > 0.0
    if of_cells is not None:
        meant &= of_cells[cell]
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
