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
    found, estimated = (_contains(n.size, of) for n, of in ((comparison.vehicle, row), (comparison.track, column)))
    instant = comparison.row_instant
    first, last = np.full(comparison.n_vehicles, NEVER), np.full(comparison.n_vehicles, -1)
    np.minimum.at(first, comparison.vehicle[row], instant[row])
    np.maximum.at(last, comparison.vehicle[row], instant[row])
    first, last = first[comparison.vehicle], last[comparison.vehicle]
    late, early = (instant < first) & (first < NEVER), (instant > last) & (last >= 0)
    inside = ~found & ~late & ~early
    row_is_near, column_is_near = (
        _contains(instant.size, clear.valid.row),
        _contains(estimated.size, clear.valid.column),
    )
    swaps = _swaps(comparison, row, column)
    return ErrorKinds(
        late_start=int(late.sum()), early_end=int(early.sum()), merged=int((inside & row_is_near).sum()),
        overlooked=int((inside & ~row_is_near).sum()), duplicate=int((~estimated & column_is_near).sum()),
        ghost=int((~estimated & ~column_is_near).sum()), swaps=swaps, breaks=clear.switches - swaps,
    )  # fmt: skip


def _contains(n: int, places: IntArray) -> BoolArray:
    """(n,) which of the places are named."""
    named = np.zeros(n, np.bool_)
    named[places] = True
    return named


def _swaps(comparison: Comparison, row: IntArray, column: IntArray) -> int:
    """How many of the matches (p,) are the first of a vehicle with a track that was last matched to another vehicle."""
    vehicle, track, instant = comparison.vehicle[row], comparison.track[column], comparison.row_instant[row]
    track_before = _before(vehicle, instant, track)
    vehicle_before = _before(track, instant, vehicle)
    is_switch = (track_before >= 0) & (track_before != track)
    return int((is_switch & (vehicle_before >= 0) & (vehicle_before != vehicle)).sum())


def _before(of: IntArray, instant: IntArray, value: IntArray) -> IntArray:
    """(p,) the value at the instant before of the same; -1 where there is none."""
    order = np.lexsort((instant, of))
    result = np.full(of.size, -1, np.int64)
    same = of[order][1:] == of[order][:-1]
    result[order[1:][same]] = value[order[:-1][same]]
    return result
