"""From cell to cell: how often vehicles went from one on to another, of all manoeuvres together (see `motion`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap


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
    n: FloatArray
    share: FloatArray


def cell_transitions(primitives: PrimitiveMap) -> Transitions:
    """The transitions that a map learned; none where it learned none. From manoeuvre to manoeuvre of a cell is none."""
    motion, n_cells = primitives.motion, primitives.tessellation.n_cells
    start, end = np.repeat(motion.cell, np.diff(motion.first)), motion.cell[motion.following]
    left = (start >= 0) & (start != end) & (motion.count > 0)
    pair, which = np.unique(start[left] * n_cells + end[left], return_inverse=True)
    n = np.bincount(which, weights=motion.count[left], minlength=pair.size).astype(np.float64)
    start, end = pair // max(n_cells, 1), pair % max(n_cells, 1)
    return Transitions(start, end, n, n / np.bincount(start, weights=n, minlength=n_cells)[start])
