"""CLEAR MOT: misses, false tracks and switches of identity, in one accuracy; IDF1: does one track stand for a vehicle?

Sources: Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics, 2008;
Ristani et al., Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking, 2016.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.evaluation.metrics.comparison import EPSILON, Comparison, Pairs
from dirprim_filter.filtering.association import best_pairs

MATCH_FROM = 0.5
"""Similarity from which a vehicle and an estimate may be matched."""
UNMATCHED = -1


class ClearMot(NamedTuple):
    """Accuracy, and the matches that it counts.

    Attributes:
        mota: 1 - (misses + false + switches) / rows of the truth; below 0 where more is wrong than there is.
        switches: how often a vehicle is matched to another track than when it was last matched.
        matches: the pairs that are matched, by instant.
    """

    mota: float
    switches: int
    matches: Pairs


def clear_mot(comparison: Comparison) -> ClearMot:
    """Match instant by instant: a match of the instant before that is still valid is kept, the others by similarity.

    Valid is a similarity of at least 0.5. An instant without vehicles or without estimates is passed over.
    """
    similarity = comparison.similarity
    is_valid = similarity >= MATCH_FROM - EPSILON
    valid = comparison.near.chosen(is_valid)
    matched, switches = _matched(comparison, valid, similarity[is_valid])
    accuracy = (2 * matched.size - comparison.track.size - switches) / max(1, comparison.vehicle.size)
    return ClearMot(accuracy, switches, valid.chosen(matched))


def _matched(comparison: Comparison, valid: Pairs, similarity: FloatArray) -> tuple[IntArray, int]:
    """The pairs that are matched, over all instants, and how many switches there are."""
    vehicle, track = comparison.vehicle[valid.row], comparison.track[valid.column]
    instants = np.intersect1d(comparison.row_instant, comparison.column_instant)
    starts = np.searchsorted(comparison.row_instant[valid.row], instants, side="left")
    ends = np.searchsorted(comparison.row_instant[valid.row], instants, side="right")
    before, last = (np.full(comparison.n_vehicles, UNMATCHED) for _ in range(2))
    matched: list[IntArray] = []
    switches = 0
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        pairs = slice(start, end)
        chosen = start + matched_at_once(vehicle[pairs], track[pairs], similarity[pairs], before)
        who, by = vehicle[chosen], track[chosen]
        switches += int(((last[who] != UNMATCHED) & (last[who] != by)).sum())
        before[:] = UNMATCHED
        before[who] = last[who] = by
        matched.append(chosen)
    return np.concatenate(matched) if matched else np.empty(0, np.int64), switches


def matched_at_once(vehicle: IntArray, track: IntArray, similarity: FloatArray, before: IntArray) -> IntArray:
    """Of (p,) valid pairs of one instant those that are matched: as the instant before, of what is left the most alike.

    Args:
        vehicle: (p,) its number.
        track: (p,) its number.
        similarity: (p,) positive.
        before: the track of each vehicle, by its number, in the instant before; `UNMATCHED` for none.
    """
    kept = before[vehicle] == track
    if kept.all():
        return np.arange(vehicle.size)
    free = np.flatnonzero(~np.isin(vehicle, vehicle[kept]) & ~np.isin(track, track[kept]))
    new = free[best_pairs(vehicle[free], track[free], similarity[free])]
    return np.concatenate([np.flatnonzero(kept), new])


def identity_f1(comparison: Comparison) -> float:
    """2 IDTP / (rows of the truth + estimates), where each vehicle is given one track for good; 0 of no rows."""
    near = comparison.near.chosen(comparison.similarity >= MATCH_FROM)
    vehicle, track, of_pair = comparison.companions(near)
    gain = np.bincount(of_pair).astype(np.float64)
    n_true = gain[best_pairs(vehicle, track, gain)].sum()
    return float(2.0 * n_true / max(1, comparison.vehicle.size + comparison.track.size))
