"""Primitives as what happens in a cell: the model that `fit_jointly` asks for, and the map of all cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.distributions.angles import wrap
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
        modes = Modes(*(np.take_along_axis(column, order, axis=1)[of] for column in modes))
        east, north = (place - self.center[of]).T[:, :, None]
        turned = modes.bend_east * east + modes.bend_north * north
        return modes._replace(
            mean=wrap(modes.mean + turned),
            rate=modes.rate * np.exp(-modes.gain_east * east - modes.gain_north * north),
        )

    def log_density(
        self, cell: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray, standing_rate: float
    ) -> FloatArray:
        """Of direction and speed of rows in cells, (n,) each, by the cells' own modes and that of standing."""
        modes, standing = self.modes, self.standing[:, None]
        moving, none = modes._replace(weight=(1.0 - standing) * modes.weight), np.zeros(standing.shape)
        still = Modes(standing, none, none, none + 1.0, none + standing_rate, none, none, none, none)
        every = Modes(*map(np.hstack, zip(moving, still, strict=True)))
        return ModeTable.of(every, self.center).log_density(cell, position, direction, speed)


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
        center=cells.center,
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
    n, left, still = cells.n_cells, np.ones((cells.n_cells, 1)), []
    cores: list[Modes] = []
    tails: list[Modes] = []
    for fits, of in levels:
        known = np.where(n_rows > 0, (fits.n_vehicles / (fits.n_vehicles + strength))[of], 0.0)[:, None]
        still.append(left * known * fits.standing[of][:, None])
        core = fits.heaviest_at(cells.centers, of)
        core = core._replace(weight=(left * known - still[-1]) * core.weight)
        shape = np.maximum(core.shape / BROADER, 1.0)
        tails.append(core._replace(
            weight=config.broad_share * core.weight, concentration=core.concentration / BROADER, shape=shape,
            rate=core.rate * shape / core.shape,
        ))  # fmt: skip
        cores.append(core._replace(weight=(1.0 - config.broad_share) * core.weight))
        left = left * (1.0 - known)
    behind = Modes(*(np.tile(column, (n, 1)) for column in background.modes))
    standing = Modes(still[0], *(column[:, -1:] for column in behind[1:]))
    behind = behind._replace(weight=left * behind.weight)
    behind.weight[:, -1:] += sum(still[1:])
    parts = [cores[0], standing, *tails, *cores[1:], behind]
    modes = [np.hstack(column) for column in zip(*parts, strict=True)]
    nowhere = np.zeros(modes[0].shape[1] - background.modes.weight.size)  # the background row has no other modes
    weight, mean, concentration, shape, rate, *slopes = (
        np.vstack([column, np.append(nowhere + (name in ("shape", "rate")), last)])
        for name, column, last in zip(Modes._fields, modes, background.modes, strict=True)
    )
    return PrimitiveMap(
        tessellation=cells,
        direction=VonMisesMixture(
            weight=weight / weight.sum(axis=1, keepdims=True), mean_direction=mean, concentration=concentration
        ),
        speed=Gamma(shape=shape, rate=rate),
        n_rows=np.append(n_rows, n_rows.sum()),
        n_background_modes=weight.shape[1] - cores[0].weight.shape[1] - 1,
        bend=np.stack(slopes[:2], axis=-1),
        gain=np.stack(slopes[2:], axis=-1),
    )
