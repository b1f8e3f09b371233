"""All cells fitted at once, on as many cores as there are."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _ascent, _kernels
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

MERGED_FROM = 16_384
"""Rows of a cell, from which on those that lie together are merged: responsibilities are then those of their means."""
BINS, CURVED_BINS = (256, 12, 1), (64, 6, 8)
"""Of direction, log speed, and each axis of the place."""
FINE = 2048
FINISHING_ITERATIONS = 10
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


def fit_all(
    in_cells: CellRows,
    bounds: Bounds,
    *,
    near: Modes | None = None,
    merged_from: int = MERGED_FROM,
    n_threads: int | None = None,
) -> Modes:
    """Fit every cell's modes to its rows; threads divide the cells, so their number changes nothing.

    Args:
        in_cells: the rows of each cell.
        bounds: priors and bounds; `with_speed`: direction and speed together and modes by BIC, or else the paper's two
            steps.
        near: (n_cells, max_modes) modes of nearly the same rows: fitted at once, cells that have any keep their number,
            and climb from there.
        merged_from: rows from which on a cell's are merged.
        n_threads: as many as there are cores if absent.

    Returns:
        (n_cells, max_modes) each; of weight 0 where a cell has no rows or fewer modes.
    """
    at_once = bounds.with_speed
    bounds = bounds._replace(curved=at_once and bounds.curved)
    whole, whole_start = columns_of(in_cells)
    merged = (np.diff(whole_start) > merged_from) & at_once
    columns, start = _with_merged(whole, whole_start, merged, CURVED_BINS if bounds.curved else BINS)
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
        rows = np.ascontiguousarray(whole[:, whole_start[i] : whole_start[i + 1]])
        _finish(rows, float(in_cells.n_vehicles[i]), bounds, table[i])

    for work, items in ((fit_share, np.arange(bound.size - 1)), (finish, np.flatnonzero(merged & bounds.curved))):
        if items.size > 1:
            with ThreadPoolExecutor(n_threads or os.cpu_count()) as pool:
                list(pool.map(work, items.tolist()))
        else:
            for item in items.tolist():
                work(item)
    return Modes.of(table, bounds)


def _finish(columns: FloatArray, n_vehicles: float, bounds: Bounds, table: FloatArray) -> None:
    """Some iterations on the rows themselves: merged, they blur what bends by some thousandths of a nat."""
    k = int((table[:, LOG_WEIGHT] > NO_MODE / 2).sum())
    table[:] = table[np.argsort(-table[:, LOG_WEIGHT], kind="stable")]
    few = bounds._replace(max_iterations=FINISHING_ITERATIONS)
    bends = bool(table[:k, N_FLAT:].any())
    _ascent.ascend(columns, 0, columns.shape[1], n_vehicles, bends, -np.inf, 0.0, few, table[:k])


def columns_of(in_cells: CellRows) -> tuple[FloatArray, IntArray]:
    """A column for each member of positive weight, sorted by cell: (N_COLUMNS, n), and where each cell's begin."""
    n_members = np.diff(in_cells.start)
    cell, meant = np.repeat(np.arange(n_members.size), n_members), in_cells.weight > 0.0
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


def _with_merged(
    columns: FloatArray, start: IntArray, merged: BoolArray, bins: tuple[int, int, int]
) -> tuple[FloatArray, IntArray]:
    """The same, where the columns of some cells are those of rows that lie together."""
    if not merged.any():
        return columns, start
    parts = [columns[:, a:b] for a, b in pairwise(start.tolist())]
    parts = [merge(part, bins) if large else part for part, large in zip(parts, merged.tolist(), strict=True)]
    return np.concatenate(parts, axis=1), np.concatenate([[0], np.cumsum([part.shape[1] for part in parts])])


def merge(columns: FloatArray, bins: tuple[int, int, int]) -> FloatArray:
    """Columns of a cell, those that lie together as one: their means, and their weight.

    So the maximisation is exact for flat modes, and only responsibilities are those of the means.
    """
    weight = columns[WEIGHT]
    key = _binned(np.arctan2(columns[SINE], columns[COSINE]), weight, bins[0])
    key = key * bins[1] + _binned(columns[LOG_SPEED], weight, bins[1])
    for axis in (EAST, NORTH) if bins[2] > 1 else ():
        key = key * bins[2] + _binned(columns[axis], weight, bins[2])
    of = np.unique(key, return_inverse=True)[1]
    total = np.bincount(of, weight)
    means = np.stack([np.bincount(of, weight * column) / total for column in columns])
    means[WEIGHT] = total
    return means


def _binned(value: FloatArray, weight: FloatArray, n: int) -> IntArray:
    """(n,) the bin of each: half of the bins by weight, so that they are fine where rows are dense, half by width."""
    fine = ((value - value.min()) * ((FINE - 1) / max(float(np.ptp(value)), 1e-300))).astype(np.int64)
    inside = np.bincount(fine, weight, FINE)
    share = 0.5 * (np.cumsum(inside) - 0.5 * inside) / inside.sum() + 0.5 * (np.arange(FINE) + 0.5) / FINE
    return np.asarray((share * n).astype(np.int64)[fine])
