"""What cells borrow: the modes of other layouts, whose borders lie elsewhere.

Where the borders between cells belong is uncertain, and what is fitted to few rows varies with them. An average over
layouts varies less: Scott (1985) of histograms, Holmes, Denison and Mallick (1999) of Voronoi cells. Here it stays one
layout with a mixture in each cell: a cell borrows the modes of the other layouts' cells that overlap it, in proportion
to its rows in each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.cell_model import PrimitiveCells
from dirprim_filter.primitives.rows import TrackRows
from tessellation import Tessellation

N_LAYOUTS = 2
"""To borrow from. With each more the density gains less, and takes longer."""
SHARES = (0.0, 0.2, 0.4, 0.6)
"""Of a cell's weight that its borrowed modes may have; held-out vehicles choose."""
LEAST_WEIGHT = 0.02
"""A borrowed mode of less is left out."""
MOST_MODES = 12
"""Borrowed by a cell: the heaviest."""


class Borrowed(NamedTuple):
    """What the cells of a layout borrow."""

    modes: Modes  # (n_cells, B) each, heaviest first, of weight 0 where a cell has fewer; at the cells' own centres
    standing: FloatArray  # (n_cells,) share of the rows that stand; with the weights of the modes it is one, or nothing
    share: float  # of all this in what a cell does not take from the place-free primitive

    @classmethod
    def none(cls, n_cells: int) -> Self:
        """Nothing is borrowed."""
        return cls(Modes(*np.zeros((len(Modes._fields), n_cells, 0))), np.zeros(n_cells), 0.0)


def borrow(
    rows: TrackRows, cells: Tessellation, lenders: Sequence[tuple[Tessellation, PrimitiveCells]], share: float
) -> Borrowed:
    """The modes of other layouts' cells, for the cells that they overlap.

    Args:
        rows: (n,) whose places say what overlaps.
        cells: that borrow.
        lenders: layouts to borrow from, and what their cells hold.
        share: see `Borrowed`.
    """
    parts = [_overlapping(rows, cells, other, fitted) for other, fitted in lenders]
    cell, weight = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    order = np.lexsort((-weight, cell))
    rank = np.arange(cell.size) - np.searchsorted(cell[order], cell[order])
    kept = order[(rank < MOST_MODES) & (weight[order] >= LEAST_WEIGHT)]
    at = cell[kept], rank[np.argsort(order)][kept]
    columns = {name: np.zeros((cells.n_cells, int(at[1].max(initial=-1)) + 1)) for name in Modes._fields}
    columns["shape"] += 1.0
    columns["rate"] += 1.0
    for i, column in enumerate(columns.values()):
        column[at] = np.concatenate([part[2][i] for part in parts])[kept]
    columns["weight"][at] = weight[kept]
    standing = np.sum([part[3] for part in parts], axis=0)
    total = columns["weight"].sum(axis=1) + standing
    known = np.where(total > 0.0, total, 1.0)
    columns["weight"] /= known[:, None]
    return Borrowed(Modes(**columns), standing / known, share)


def _overlapping(
    rows: TrackRows, cells: Tessellation, other: Tessellation, fitted: PrimitiveCells
) -> tuple[IntArray, FloatArray, Modes, FloatArray]:
    """Pairs of a cell and a mode of a cell that overlaps it.

    -> (p,) cell, (p,) weight, the modes at the centre of that cell, and (n_cells,) how much stands.
    """
    home, there = cells.cell_of(rows.position), other.cell_of(rows.position)
    shared = (home >= 0) & (there >= 0)
    overlap = coo_array(
        (np.ones(int(shared.sum())), (home[shared], there[shared])), shape=(cells.n_cells, other.n_cells)
    ).tocsr()
    overlap.sum_duplicates()
    cell, lender = (np.asarray(index, np.int64) for index in overlap.nonzero())
    part = overlap.data / np.asarray(overlap.sum(axis=1)).ravel()[cell]
    weight = part[:, None] * (1.0 - fitted.standing[lender])[:, None] * fitted.weight[lender]
    pair, mode = np.nonzero(weight)
    found = Modes(*(getattr(fitted, name)[lender[pair], mode] for name in Modes._fields))
    east, north = (cells.centers[cell[pair]] - fitted.center[lender[pair]]).T
    found = found._replace(
        mean=found.mean + found.bend_east * east + found.bend_north * north,
        rate=found.rate * np.exp(-found.gain_east * east - found.gain_north * north),
    )
    standing = np.asarray(np.bincount(cell, part * fitted.standing[lender], minlength=cells.n_cells), np.float64)
    return cell[pair], weight[pair, mode], found, standing
