"""A part of a map: the cells near some places, and what is known of all the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from dirprim_filter.primitives.traffic import Traffic


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What a part of a map knows of the whole: vehicles of all places together tell how many there are at each.

    Attributes:
        manoeuvre: (n_placed,) which of the map's the part's are.
        traffic: of the map; None where it counted no transitions.
    """

    manoeuvre: IntArray
    traffic: Traffic | None


class Ground(NamedTuple):
    """The ground within reach of some places."""

    place: FloatArray  # (n, 2) metres
    reach_m: float

    def covers(self, position: FloatArray) -> BoolArray:
        """(k, 2) -> (k,)."""
        if not len(self.place):
            return np.zeros(len(position), np.bool_)
        return np.asarray(np.isfinite(cKDTree(self.place).query(position, distance_upper_bound=self.reach_m)[0]))
