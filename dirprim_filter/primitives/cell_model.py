"""Primitives as what happens in a cell: the model that `fit_jointly` asks for, and the map of all cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives._map_kernels import ModeTable
from dirprim_filter.primitives._modes import Bounds, Modes
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.fitting import fit_all
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import CellRows, TrackRows
from tessellation import Tessellation
from tessellation.gates import members_of, residents
from tessellation.protocols import Members

LEAST_SPEED = 1e-3
"""m/s; slower rows are taken for so fast, for at 0 a gamma's density is 0 or without bound."""
BROADER = 16.0
"""Tails have so many times a mode's variance of direction and of log speed; 8 and 32 give the same to .005 nat."""


class PrimitiveCells(NamedTuple):
    """What the fit found in each cell, before the background model enters."""

    table: FloatArray  # (n_cells, K, N_CURVED) of modes in motion, see `_modes`
    standing: FloatArray  # (n_cells,) share of the rows that stand
    n_vehicles: FloatArray  # (n_cells,) that move; at least one where there are rows
    n_rows: FloatArray  # (n_cells,) by weight
    center: FloatArray  # (n_cells, 2) metres

    @property
    def modes(self) -> Modes:
        """Those in motion."""
        return Modes.of(self.table)

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
    """Directional primitives of cells, leaning on the background one."""

    bounds: Bounds
    background: Background
    background_vehicles: float
    background_log_density: FloatArray  # (n,) log density of each row by the background model

    def fit(self, position: FloatArray, data: TrackRows, members: Members) -> PrimitiveCells:
        """Every cell's modes; see `tessellation.CellModel`. `position` may be from another origin than the rows'."""
        return fitted(data, members, position, self.bounds)

    def log_density(
        self, cells: PrimitiveCells, position: FloatArray, data: TrackRows, row: IntArray, cell: IntArray
    ) -> FloatArray:
        """Of direction and speed of each row in a cell, with the background model's part."""
        speed = np.maximum(data.speed[row], LEAST_SPEED)
        own = cells.log_density(cell, position[row], data.direction[row], speed, float(self.background.modes.rate[-1]))
        share = self.background_vehicles / (cells.n_vehicles + self.background_vehicles)
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log1p(-share)[cell] + own, np.log(share)[cell] + self.background_log_density[row])


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


def fit_cells(rows: TrackRows, layout: Layout, bounds: Bounds) -> PrimitiveCells:
    """Fit each cell's modes to the rows that it learns from."""
    cells, softness = layout
    if softness > 0:
        members, _ = members_of(rows.position, cells.centers, softness=softness)
    else:
        members = residents(cells.cell_of(rows.position), cells.centers)
    return fitted(rows, members, rows.position, bounds)


def assemble(cells: Tessellation, fits: PrimitiveCells, background: Background, config: LearningConfig) -> PrimitiveMap:
    """A map before its motion is learned: each cell's modes, heaviest first, their tails, and the background ones.

    Args:
        cells: (n,) of the map.
        fits: what each holds.
        background: the background model.
        config: how much tails and the background model weigh.
    """
    n, modes = len(fits.center), fits.modes
    used = max(int((modes.weight > 0).sum(axis=1).max(initial=0)), 1)
    order = np.argsort(-modes.weight, axis=1, kind="stable")[:, :used]
    shape = np.maximum(modes.shape / BROADER, 1.0)
    rate = modes.rate * shape / modes.shape
    tails = modes._replace(concentration=modes.concentration / BROADER, shape=shape, rate=rate)

    def column(name: str, filler: float) -> FloatArray:
        """The cells' modes in motion, the one for standing, tails, and background modes; last the background row."""
        own = np.take_along_axis(getattr(modes, name), order, axis=1)
        tail = np.take_along_axis(getattr(tails, name), order, axis=1)
        of_background = getattr(background.modes, name)
        placed = np.hstack([own, np.full((n, 1), of_background[-1]), tail])
        return np.hstack([np.vstack([placed, np.full(placed.shape[1], filler)]), np.tile(of_background, (n + 1, 1))])

    share = (config.background_vehicles / (fits.n_vehicles + config.background_vehicles))[:, None]
    placed, moves = 2 * used + 1, (1 - fits.standing)[:, None]
    weight = column("weight", 0.0)
    weight[:n, :used] *= moves * (1 - config.broad_share)
    weight[:n, used] = fits.standing
    weight[:n, used + 1 : placed] *= moves * config.broad_share
    weight[:n, :placed] *= 1 - share
    weight[:n, placed:] *= share
    weight /= weight.sum(axis=1, keepdims=True)
    n_rows = np.round(fits.n_rows).astype(np.int64)
    return PrimitiveMap(
        tessellation=cells,
        direction=VonMisesMixture(
            weight=weight, mean_direction=column("mean", 0.0), concentration=column("concentration", 0.0)
        ),
        speed=Gamma(shape=column("shape", 1.0), rate=column("rate", 1.0)),
        n_rows=np.append(n_rows, n_rows.sum()),
        n_background_modes=used + background.modes.weight.size,
        bend=np.stack([column("bend_east", 0.0), column("bend_north", 0.0)], axis=-1),
        gain=np.stack([column("gain_east", 0.0), column("gain_north", 0.0)], axis=-1),
    )
