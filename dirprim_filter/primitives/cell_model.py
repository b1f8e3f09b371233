"""Primitives as what happens in a cell: the model that `fit_jointly` asks for, and the map of all cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives._map_kernels import ModeTable
from dirprim_filter.primitives._modes import Bounds, Modes
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.fitting import fit_all
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import CellRows, TrackRows
from tessellation import Tessellation
from tessellation.gates import members_of, nearest_generators, residents, unite
from tessellation.protocols import Members
from tessellation.voronoi import lloyd_generators

LEAST_SPEED = 1e-3
"""m/s; slower rows are taken for so fast, for at 0 a gamma's density is 0 or without bound."""
BROADER = 16.0
"""Tails have so many times a mode's variance of direction and of log speed; 8 and 32 give the same to .005 nat."""
N_PARENTS, CHILDREN = 2, 4
"""Of each cell, and of each parent; with one more held-out densities are no higher."""
PLACED_ROWS = 20_000
"""By about so many parents are laid out, and evenly."""


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


def fit_cells(rows: TrackRows, layout: Layout, bounds: Bounds) -> PrimitiveCells:
    """Fit each cell's modes to the rows that it learns from."""
    return fitted(rows, layout.members(rows.position), rows.position, bounds)


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


def assemble(
    cells: Tessellation, levels: list[Level], background: Background, config: LearningConfig, strength: float
) -> PrimitiveMap:
    """A map before its motion is learned: each cell's modes, heaviest first, one for standing, and what it leans on.

    That are tails of the modes, the modes of its parents with theirs, and the background ones.

    Args:
        cells: (n,) of the map.
        levels: what they hold, and what their parents do.
        background: the background model.
        config: how much tails weigh.
        strength: pseudo-vehicles with which its parent enters each cell, and the background model the last of them.
    """
    n_rows = np.round(levels[0].fits.n_rows[levels[0].of]).astype(np.int64)
    left, standing, cores, tails = np.ones((cells.n_cells, 1)), list[FloatArray](), list[Modes](), list[Modes]()
    for fits, of in levels:
        known = np.where(n_rows > 0, (fits.n_vehicles / (fits.n_vehicles + strength))[of], 0.0)[:, None]
        standing.append(left * known * fits.standing[of][:, None])
        core = fits.heaviest_at(cells.centers, of).times(left * known - standing[-1])
        shape = np.maximum(core.shape / BROADER, 1.0)
        tails.append(core.times(config.broad_share)._replace(
            concentration=core.concentration / BROADER, shape=shape, rate=core.rate * shape / core.shape
        ))  # fmt: skip
        cores.append(core.times(1.0 - config.broad_share))
        left = left * (1.0 - known)
    behind = background.modes.take(np.zeros(cells.n_cells, np.int64)).times(left)
    still = behind.take((slice(None), slice(-1, None)))._replace(weight=standing[0])
    behind.weight[:, -1:] += sum(standing[1:])
    modes = Modes.beside([cores[0], still, *tails, *cores[1:], behind])
    width = modes.weight.shape[1]
    nothing = (1, width - background.modes.weight.size)  # the background row has no other modes
    nowhere = Modes.beside([Modes.flat(*np.zeros((3, *nothing)), *np.ones((2, *nothing))), background.modes])
    modes = Modes(*map(np.concatenate, zip(modes, nowhere, strict=True)))
    return PrimitiveMap(
        tessellation=cells,
        modes=modes._replace(weight=modes.weight / modes.weight.sum(axis=1, keepdims=True)),
        n_rows=np.append(n_rows, n_rows.sum()),
        n_background_modes=width - cores[0].weight.shape[1] - 1,
    )
