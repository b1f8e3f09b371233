"""IDF1: for how long does one track stand for one vehicle?

Source: Ristani et al., Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking, 2016.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.evaluation.metrics.clear_mot import MATCH_FROM
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.matching import best_pairs


def identity_f1(comparison: Comparison, *, similarity_m: float = 5.0) -> float:
    """2 IDTP / (rows of the truth + estimates), where each vehicle is given one track for good; 0 of no rows.

    Raises:
        ValueError: `similarity_m` is not positive, or beyond the comparison's reach.
    """
    near = comparison.within(similarity_m)
    near = near.chosen(near.similarity(similarity_m) >= MATCH_FROM)
    vehicle, track, of_pair = comparison.companions(near)
    gain = np.bincount(of_pair).astype(np.float64)
    n_true = gain[best_pairs(vehicle, track, gain)].sum()
    return float(2.0 * n_true / max(1, comparison.vehicle.size + comparison.track.size))
