"""How far is a set of estimates from the set of vehicles? The GOSPA metric and its parts.

Source: Rahmathullah, Garcia-Fernandez and Svensson, Generalized Optimal Sub-Pattern Assignment Metric, 2017, with
alpha = 2, where a missed vehicle and a false track cost half of the cut-off each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.evaluation.metrics.comparison import Comparison, Pairs
from dirprim_filter.filtering.association import best_pairs

ORDER = 2


class Gospa(NamedTuple):
    """The metric of order 2, its square summed over instants.

    Attributes:
        localisation: square metres, from estimates to the vehicles they are given to.
        missed: square metres, half the squared cut-off for each vehicle without an estimate.
        false: square metres, the same for each estimate without a vehicle.
        pairs: which estimates are given to which vehicles.
    """

    localisation: float
    missed: float
    false: float
    pairs: Pairs

    @property
    def distance(self) -> float:
        """Metres; of one instant the metric itself, sqrt(localisation + missed + false)."""
        return float(np.sqrt(self.localisation + self.missed + self.false))


def gospa(comparison: Comparison) -> Gospa:
    """The metric at every instant, summed; its cut-off is the distance from which nothing is similar."""
    near, cutoff_m = comparison.near, comparison.similarity_m
    pairs = near.chosen(best_pairs(near.row, near.column, cutoff_m**ORDER - near.distance**ORDER))
    half = 0.5 * cutoff_m**ORDER
    n = pairs.row.size
    return Gospa(
        localisation=float((pairs.distance**ORDER).sum()),
        missed=half * (comparison.vehicle.size - n),
        false=half * (comparison.track.size - n),
        pairs=pairs,
    )
