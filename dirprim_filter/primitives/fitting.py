"""What happens in a cell, and all cells fitted at once, on as many cores as there are; their parents likewise.

The paper's recipe counts modes on directions alone, and fits speeds when directions are fitted: Senanayake et al. 2020,
section III; Anderson and Ray, Improved maximum likelihood estimators for the gamma distribution, 1975.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions._estimates import shape_from
from dirprim_filter.distributions.modes import dbscan
from dirprim_filter.primitives import _kernels
from dirprim_filter.primitives._em import maximisation
from dirprim_filter.primitives._map_kernels import ModeTable
from dirprim_filter.primitives._modes import (
    COSINE,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_SPEED,
    MEAN,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
    Modes,
    empty_table,
)
from dirprim_filter.primitives.rows import CellRows, TrackRows
from tessellation import Tessellation
from tessellation.gates import members_of, nearest_generators, residents, unite
from tessellation.protocols import Members
from tessellation.voronoi import lloyd_generators

MIN_STANDING_MEAN = 0.05
"""m/s; standing vehicles of a simulator have speed 0, which would make the density at 0 unbounded."""
MIN_SPREAD = 1e-3
"""Of log speeds, log(mean) - mean(log): a log of one speed does not say that all others are as like."""

LEAST_SPEED = 1e-3
"""m/s; slower rows are taken for so fast, for at 0 a gamma's density is 0 or without bound."""
N_PARENTS, CHILDREN = 2, 4
"""Of each cell, and of each parent; with one more held-out densities are no higher."""
PLACED_ROWS = 20_000
"""By about so many parents are laid out, and evenly."""
MOST_ROWS = 16_384
"""Of a cell: of more every second, third, ... is fitted, for rows of a vehicle stand together and repeat each other."""
ROUGH: dict[str, Any] = {"thorough": False, "tolerance": 1e-3, "parameter_cost": 1.0}
"""Of bounds, while cells are looked for: such fits are compared, not kept, and cells of fewer modes last."""
SHARE = 8192
"""Threads take cells of so many rows at a time: few enough to level out what cells cost, and a thread is worth it."""
ROWS_OF_A_CELL = 32
"""A cell costs as many rows do, beside its own."""


def bounds_of(config: LearningConfig, **others: Any) -> Bounds:
    """The priors and bounds of a fit: those that the configuration has too, and others, see `Bounds`."""
    shared = (name for name in Bounds._fields if name not in Bounds._field_defaults)
    return Bounds(**{name: getattr(config, name) for name in shared} | others)


class PrimitiveCells(NamedTuple):
    """What the fit found in each cell, before parents and the background model enter."""

    table: FloatArray  # (n_cells, K, N_CURVED) of modes in motion, see `_modes`
    standing: FloatArray  # (n_cells,) share of the rows that stand
    n_vehicles: FloatArray  # (n_cells,) that move; at least one where there are rows
    n_rows: FloatArray  # (n_cells,) by weight
    center: FloatArray  # (n_cells, 2) metres

    @property
    def modes(self) -> Modes:
        """Those in motion."""
        return Modes.of(self.table)

    def heaviest_at(self, place: FloatArray, of: IntArray) -> Modes:
        """(n, K) modes of the cells `of` (n,), heaviest first, as they are at places (n, 2); as many as any has."""
        modes = self.modes
        used = max(int((modes.weight > 0).sum(axis=1).max(initial=0)), 1)
        order = np.argsort(-modes.weight, axis=1, kind="stable")[:, :used]
        return modes.take((of[:, None], order[of])).at(place - self.center[of])

    def log_density(
        self, cell: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray, standing_rate: float
    ) -> FloatArray:
        """Of direction and speed of rows in cells, (n,) each, by the cells' own modes and that of standing."""
        standing = self.standing[:, None]
        none = 0.0 * standing
        still = Modes.flat(standing, none, none, none + 1.0, none + standing_rate)
        modes = Modes.beside([self.modes.times(1.0 - standing), still])
        return ModeTable.of(modes, self.center).log_density(cell, position, direction, speed)


class PrimitiveModel(NamedTuple):
    """Directional primitives of cells, leaning on those of parents."""

    bounds: Bounds
    standing_rate: float
    strength: float  # pseudo-vehicles of what they lean on
    backing: FloatArray  # (n,) log density of each row by parents that other vehicles drove

    def fit(self, position: FloatArray, data: TrackRows, members: Members) -> PrimitiveCells:
        """Every cell's modes; see `tessellation.CellModel`. `position` may be from another origin than the rows'."""
        return fitted(data, members, position, self.bounds)

    def log_density(
        self, cells: PrimitiveCells, position: FloatArray, data: TrackRows, row: IntArray, cell: IntArray
    ) -> FloatArray:
        """Of direction and speed of each row in a cell, with the parents' part."""
        speed = np.maximum(data.speed[row], LEAST_SPEED)
        own = cells.log_density(cell, position[row], data.direction[row], speed, self.standing_rate)
        share = self.strength / (cells.n_vehicles + self.strength)
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log1p(-share)[cell] + own, np.log(share)[cell] + self.backing[row])


def fitted(rows: TrackRows, members: Members, position: FloatArray, bounds: Bounds) -> PrimitiveCells:
    """Every cell's modes; see `CellRows.of`."""
    cells = CellRows.of(rows, members, position, standing_speed=bounds.standing_speed)
    n_rows = cells.n_moving + cells.n_standing
    return PrimitiveCells(
        table=fit_all(cells, bounds),
        standing=cells.n_standing / np.maximum(n_rows, 1e-9),
        n_vehicles=np.where(n_rows > 0, np.maximum(cells.n_vehicles, np.minimum(n_rows, 1.0)), 0.0),
        n_rows=n_rows,
        center=members.center,
    )


class Layout(NamedTuple):
    """Cells, and how much of what is beside them they learn from; see `tessellation.gates`."""

    cells: Tessellation
    softness: float

    def members(self, position: FloatArray) -> Members:
        """Each cell's, of rows at positions (n, 2)."""
        if self.softness > 0:
            return members_of(position, self.cells.centers, softness=self.softness)[0]
        return residents(self.cells.cell_of(position), self.cells.centers)


class Level(NamedTuple):
    """Cells that those of a map are in: the cells themselves, their parents, or the parents of these."""

    fits: PrimitiveCells
    of: IntArray  # (n_cells,) which of them each cell of the map is in


def fit_levels(rows: TrackRows, layout: Layout, bounds: Bounds) -> list[Level]:
    """The cells, then their parents, which are of some `CHILDREN` cells near each other and their rows, then theirs."""
    place = rows.position[:: 1 + len(rows) // PLACED_ROWS]
    members, of = layout.members(rows.position), np.arange(layout.cells.n_cells)
    levels = [Level(fitted(rows, members, rows.position, bounds), of)]
    while len(levels) <= N_PARENTS and len(members.center) >= 2 * CHILDREN:
        uniform = np.random.default_rng(0).random(len(members.center) // CHILDREN)
        center = lloyd_generators(place, uniform)
        parent = nearest_generators(members.center, center, k=1)[1][:, 0]
        members, of = unite(members, parent, center), parent[of]
        levels.append(Level(fitted(rows, members, rows.position, bounds), of))
    return levels


def fit_all(rows: CellRows, bounds: Bounds) -> FloatArray:
    """Fit every cell's modes to its rows; threads divide the cells, so their number changes nothing.

    Args:
        rows: of each cell.
        bounds: priors and bounds; `with_speed`: direction and speed together and modes by BIC, or else the paper's two
            steps.

    Returns:
        (n_cells, max_modes, N_CURVED) a table of modes, see `_modes`; none where a cell has no rows or fewer modes.
    """
    columns, start = some_columns(rows)
    n_rows, n_cells = np.diff(start), rows.n_vehicles.size  # of a large cell fewer rows, which are not of more vehicles
    n_vehicles = np.where(n_rows < MOST_ROWS // 2, rows.n_vehicles, np.minimum(rows.n_vehicles, n_rows))
    table = empty_table(n_cells, bounds.max_modes)
    cost = start + ROWS_OF_A_CELL * np.arange(n_cells + 1)
    bound = np.unique(np.append(np.searchsorted(cost, np.arange(0, cost[-1], SHARE)), n_cells))

    def fit_share(i: int) -> None:
        if bounds.with_speed:
            _kernels.fit_cells_at_once(columns, start, n_vehicles, bounds, bound[i], bound[i + 1], table)
            return
        for c in range(bound[i], bound[i + 1]):
            own = np.ascontiguousarray(columns[:, start[c] : start[c + 1]])
            fit_in_two_steps(own, float(n_vehicles[c]), bounds, table[c])

    if bound.size > 2:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(fit_share, range(bound.size - 1)))
    elif bound.size > 1:
        fit_share(0)
    return table


def some_columns(rows: CellRows) -> tuple[FloatArray, IntArray]:
    """The columns that are fitted, of large cells some, and where each cell's begin; see `MOST_ROWS`."""
    n_rows = np.diff(rows.start)
    stride = np.repeat(1 + n_rows // MOST_ROWS, n_rows)
    if (stride == 1).all():
        return rows.columns, rows.start
    kept = (np.arange(stride.size) - np.repeat(rows.start[:-1], n_rows)) % stride == 0
    return np.ascontiguousarray(rows.columns[:, kept]), np.append(0, np.cumsum(kept))[rows.start]


def fit_in_two_steps(columns: FloatArray, n_vehicles: float, bounds: Bounds, out: FloatArray) -> None:
    """Fill the table of a cell: DBSCAN for the number of modes, EM on directions, then a gamma for each mode."""
    n, filled = columns.shape[1], np.empty((3, _kernels.ON_CIRCLE))
    used, total, mean_speed = _kernels.sort_around(columns, 0, n, filled)
    if mean_speed == 0.0:
        return
    share = max(3, math.ceil(bounds.dbscan_share * n))
    label = dbscan(np.arctan2(columns[SINE], columns[COSINE]), eps=bounds.dbscan_eps, min_samples=share)
    k = min(max(int(label.max()) + 1, 1), bounds.max_modes)
    table = out[:k]
    _kernels.start_evenly(filled, used, total, mean_speed, bounds, table)
    one = np.vstack([np.ones(n), columns[[COSINE, SINE, SPEED, LOG_SPEED]]])
    sums = np.stack([(one * (columns[WEIGHT] * (label == m))).sum(axis=1) for m in range(k)])
    if sums[:, 0].min() > 0.0:
        maximisation(sums, n_vehicles, bounds, table)
    _kernels.ascend(columns, 0, n, n_vehicles, bounds.curved, -np.inf, 0.0, bounds, table)
    for mode in table:
        _fit_speeds(columns, bounds, mode)


def _fit_speeds(columns: FloatArray, bounds: Bounds, mode: FloatArray) -> None:
    """Eq. 3: maximum likelihood on rows within two circular standard deviations, sqrt(-2 log R), of the mode.

    The shape's bias is reduced as Anderson and Ray (1975) do: a (n - 3) / n + 2 / (3 n).
    """
    resultant = float(von_mises.mean_resultant_length(np.expm1(mode[LOG_CONCENTRATION])))
    reach = 2.0 * math.sqrt(-2.0 * math.log(max(resultant, 1e-12)))
    along = columns[COSINE] * math.cos(mode[MEAN]) + columns[SINE] * math.sin(mode[MEAN])
    near = columns[:, along >= math.cos(min(reach, math.pi))]
    n = near.shape[1]
    if n < 4:  # too few to estimate a spread: keep that of EM's last step
        return
    weight = near[WEIGHT] / near[WEIGHT].sum()
    log_mean = math.log(weight @ near[SPEED])
    shape = shape_from(log_mean - weight @ near[LOG_SPEED], bounds.max_shape) * (n - 3) / n + 2.0 / (3.0 * n)
    mode[LOG_SHAPE] = math.log(min(max(shape, 1.0), bounds.max_shape))
    mode[LOG_MEAN_SPEED] = log_mean
