"""A map assembled: cells that are laid out, what was fitted in each, and the background model beside it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives._modes import Bounds
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.cell_model import PrimitiveCells, fitted
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import CellRows, TrackRows
from tessellation import Tessellation
from tessellation.gates import members_of, residents
from tessellation.protocols import Members

BROADER = 16.0
"""Tails have so many times a mode's variance of direction and of log speed; 8 and 32 give the same to .005 nat."""


class Layout(NamedTuple):
    """Cells, and how much of what is beside them they learn from; see `tessellation.gates`."""

    cells: Tessellation
    softness: float

    def members(self, position: FloatArray) -> Members:
        """Which rows each cell learns from."""
        if self.softness > 0:
            return members_of(position, self.cells.centers, softness=self.softness)[0]
        return residents(self.cells.cell_of(position), self.cells.centers)


def fit_cells(rows: TrackRows, layout: Layout, bounds: Bounds) -> PrimitiveCells:
    """Fit each cell's modes to the rows that it learns from."""
    members = layout.members(rows.position)
    return fitted(CellRows.of(rows, members, rows.position, standing_speed=bounds.standing_speed), bounds)


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
    of_name = dict(zip(background._fields, background, strict=True))

    def column(name: str, filler: float) -> FloatArray:
        """The cells' modes in motion, the one for standing, tails, and background modes; last the background row."""
        own = np.take_along_axis(getattr(modes, name), order, axis=1)
        tail = np.take_along_axis(getattr(tails, name), order, axis=1)
        of_background = np.asarray(of_name.get(name, np.zeros_like(background.weight)))
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
        n_background_modes=used + background.weight.size,
        bend=np.stack([column("bend_east", 0.0), column("bend_north", 0.0)], axis=-1),
        gain=np.stack([column("gain_east", 0.0), column("gain_north", 0.0)], axis=-1),
    )
