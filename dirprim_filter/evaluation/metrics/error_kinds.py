"""Errors of tracking by kind: what CLEAR MOT counts as misses, false estimates and switches, each divided by its cause.

Source: after Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics, 2008,
whose matches these are of.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.evaluation.metrics.clear_mot import ClearMot
from dirprim_filter.evaluation.metrics.comparison import Comparison

NEVER = np.iinfo(np.int64).max


class ErrorKinds(NamedTuple):
    """How often each error happens. The first four add to the misses, the next two to the false, the last to switches.

    Attributes:
        late_start: rows of the truth before the first match of their vehicle.
        early_end: rows of the truth after the last match of their vehicle.
        merged: other rows of the truth without a match, near an estimate that is matched to another vehicle.
        overlooked: rows of the truth without a match and without an estimate near, or of vehicles never matched.
        duplicate: estimates without a match, near a vehicle that is matched to another track.
        ghost: estimates without a vehicle near.
        swaps: a vehicle goes on under a track that was another vehicle's before.
        breaks: a vehicle goes on under another track, which was no other vehicle's when last matched.
    """

    late_start: int
    early_end: int
    merged: int
    overlooked: int
    duplicate: int
    ghost: int
    swaps: int
    breaks: int


def error_kinds(comparison: Comparison, clear: ClearMot) -> ErrorKinds:
    """Divide the errors that CLEAR MOT counts; near is what may be matched."""
    row, column, _ = clear.matches
    vehicle, instant = comparison.vehicle, comparison.row_instant
    first, last = np.full(comparison.n_vehicles, NEVER), np.full(comparison.n_vehicles, -1)
    np.minimum.at(first, vehicle[row], instant[row])
    np.maximum.at(last, vehicle[row], instant[row])
    late = (instant < first[vehicle]) & (last[vehicle] >= 0)
    early = (instant > last[vehicle]) & (last[vehicle] >= 0)
    missed = ~_contains(instant.size, row) & ~late & ~early
    false = ~_contains(comparison.track.size, column)
    merged = int((missed & _contains(instant.size, clear.valid.row)).sum())
    duplicate = int((false & _contains(false.size, clear.valid.column)).sum())
    swaps = _swaps(comparison, row, column)
    return ErrorKinds(
        late_start=int(late.sum()), early_end=int(early.sum()), merged=merged, overlooked=int(missed.sum()) - merged,
        duplicate=duplicate, ghost=int(false.sum()) - duplicate, swaps=swaps, breaks=clear.switches - swaps,
    )  # fmt: skip


def _contains(n: int, places: IntArray) -> BoolArray:
    """(n,) which of the places are named."""
    return np.bincount(places, minlength=n) > 0


def _swaps(comparison: Comparison, row: IntArray, column: IntArray) -> int:
    """How many of the matches (p,) are the first of a vehicle with a track that was last matched to another vehicle."""
    vehicle, track, instant = comparison.vehicle[row], comparison.track[column], comparison.row_instant[row]
    track_before, vehicle_before = _before(vehicle, instant, track), _before(track, instant, vehicle)
    is_other = [(before >= 0) & (before != now) for before, now in ((track_before, track), (vehicle_before, vehicle))]
    return int((is_other[0] & is_other[1]).sum())


def _before(of: IntArray, instant: IntArray, value: IntArray) -> IntArray:
    """(p,) the value at the instant before of the same; -1 where there is none."""
    order = np.lexsort((instant, of))
    result = np.full(of.size, -1, np.int64)
    same = of[order][1:] == of[order][:-1]
    result[order[1:][same]] = value[order[:-1][same]]
    return result
