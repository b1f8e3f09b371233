"""From cell to cell: how often the vehicles whose journeys a map remembers went from one cell on to another.

Senanayake et al. 2020 name interactions between cells as future work. Motion follows whole journeys (see `journeys`);
their transitions tell at a glance which way a map lets vehicles go on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import OUTSIDE
from tessellation.arrays import FloatArray, IntArray

STEP = 0.25
"""Of a usual cell's width: so densely journeys are looked at, that no cell on the way is passed over."""
MOST_STEPS = 64
"""Of one row of a journey; half a second of it is a few cells."""


class Transitions(NamedTuple):
    """Pairs of cells that vehicles went between, in order of the first cell, then the second.

    Attributes:
        start: (n,) the cell they left.
        end: (n,) the cell that they came into.
        n: (n,) how often.
        share: (n,) of all that left the first cell for another.
    """

    start: IntArray
    end: IntArray
    n: IntArray
    share: FloatArray


def cell_transitions(primitives: PrimitiveMap) -> Transitions:
    """The transitions of a map's journeys; none where it remembers none. Ways through no cell are none."""
    journeys, n_cells = primitives.journeys, primitives.tessellation.n_cells
    goes_on = np.flatnonzero(journeys.duration > 0)
    if goes_on.size == 0 or n_cells == 0:
        nothing = np.empty(0, np.int64)
        return Transitions(nothing, nothing, nothing, np.empty(0))
    way = journeys.position[goes_on + 1] - journeys.position[goes_on]
    step = STEP * float(np.sqrt(np.median(primitives.tessellation.area)))
    n_steps = np.clip(np.ceil(np.hypot(*way.T) / step), 1, MOST_STEPS).astype(np.int64)
    # From row to row in even steps; the first of each row follows the last of the row before.
    row = np.repeat(np.arange(goes_on.size), n_steps)
    along = (np.arange(row.size) - np.repeat(np.cumsum(n_steps) - n_steps, n_steps)) / n_steps[row]
    before = primitives.tessellation.cell_of(journeys.position[goes_on[row]] + along[:, None] * way[row])
    after = primitives.tessellation.cell_of(
        journeys.position[goes_on[row]] + (along + 1.0 / n_steps[row])[:, None] * way[row]
    )
    changed = (before != after) & (before != OUTSIDE) & (after != OUTSIDE)
    pair, count = np.unique(before[changed] * n_cells + after[changed], return_counts=True)
    start, end = pair // n_cells, pair % n_cells
    leaving = np.bincount(start, weights=count, minlength=n_cells)
    return Transitions(start, end, count.astype(np.int64), count / leaving[start])
