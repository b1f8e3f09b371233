"""Who drove which mode of which cell, and how fast: from what weights and mean speeds of a map are refitted."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.visits import Visits

WIDEST_PACE = 10.0
"""Times as fast as the mode, or as slow, is the most that counts."""


class Driven(NamedTuple):
    """A row for each vehicle, cell, and mode that it drove there: one vote however often it did."""

    vehicle: IntArray
    cell: IntArray
    mode: IntArray
    ratio: FloatArray  # of its mean speed to that of the mode at its places; 1 where it stood

    def some(self, rows: BoolArray) -> Driven:
        """Those that are chosen, (n,)."""
        return Driven(*(column[rows] for column in self))  # type: ignore[arg-type]

    @classmethod
    def of(cls, learned: PrimitiveMap, visits: Visits, mode: IntArray) -> Self:
        """Of visits, and the mode of each. (v,)."""
        inside, at = np.flatnonzero(visits.cell >= 0), visits.inside
        of_visit = visits.of_instant[at]
        usual = _means(learned, visits.position[at], visits.cell[of_visit], mode[of_visit])
        ratio = np.bincount(of_visit, visits.speed[at] / usual, len(visits)) / np.maximum(visits.end - visits.begin, 1)
        ratio = np.where(visits.stands, 1.0, np.clip(ratio, 1.0 / WIDEST_PACE, WIDEST_PACE))
        key = np.column_stack([visits.vehicle[visits.begin], visits.cell, mode])[inside]
        different, row = np.unique(key, axis=0, return_inverse=True)
        vehicle, cell, of_mode = different.T
        return cls(vehicle, cell, of_mode, np.bincount(row, ratio[inside]) / np.bincount(row))


def _means(learned: PrimitiveMap, position: FloatArray, cell: IntArray, mode: IntArray) -> FloatArray:
    """(n,) the mean speed of modes at places."""
    gain = (learned.gain[cell, mode] * (position - learned.centers[cell])).sum(axis=1)
    return np.asarray(learned.speed.mean[cell, mode] * np.exp(gain))
