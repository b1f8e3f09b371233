"""Pieces of the tracks of moving vehicles, unrolled along smooth ways: what a sensor's errors are learned from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.track_ids import vehicle_numbers

LONGEST, FEWEST = 50, 12
"""Detections of a piece."""
LEAST_STEP_S = 0.09
"""Detections nearer in time are passed over: pieces would be too short to tell errors that last from white ones."""
LONGEST_PAUSE_S = 1.0
MOVING_FROM = 0.5
"""m/s: of slower vehicles the way has no direction that is worth to be known."""
BEND_S, MOST_BENDS = 1.6, 3
"""Seconds of a piece for each degree of the polynomial in time whose course it is unrolled by, and the highest degree:
of short pieces a course that bends would follow the errors that last."""
STRAYS = 6.0
"""Robust standard deviations from the middle of its neighbours, from which on a detection is left out."""
MAD = 1.4826


class Pieces(NamedTuple):
    """Detections of vehicles in motion. (w, n) pieces, the longest first, padded where they are shorter.

    Attributes:
        step_s: (w, n) seconds since the row before.
        along: (w, n) metres along the way from the first row.
        across: (w, n) metres across it, to the left.
        length: (w,) rows.
    """

    step_s: FloatArray
    along: FloatArray
    across: FloatArray
    length: IntArray


def pieces_of(named: Detections, *, n_most: int, rng: np.random.Generator) -> Pieces:
    """At most so many pieces, drawn from all that there are.

    Args:
        named: detections with ids.
        n_most: how many.
        rng: which.
    """
    vehicle = vehicle_numbers(named.track_id, named.group)
    order = np.lexsort((named.time_ns, vehicle))
    vehicle, time_s, place = vehicle[order], (named.time_ns[order] - named.time_ns.min()) * 1e-9, named.position[order]
    slot = np.floor(time_s / LEAST_STEP_S)
    kept = (np.diff(slot, prepend=-1.0) != 0) | (np.diff(vehicle, prepend=-1) != 0)
    vehicle, time_s, place = vehicle[kept], time_s[kept], place[kept]
    kept = ~_strays(vehicle, time_s, place)
    vehicle, time_s, place = vehicle[kept], time_s[kept], place[kept]
    begins = np.flatnonzero((np.diff(vehicle, prepend=-1) != 0) | (np.diff(time_s, prepend=-np.inf) > LONGEST_PAUSE_S))
    cuts = [np.arange(start, end, LONGEST) for start, end in zip(begins, [*begins[1:], time_s.size], strict=True)]
    rows = np.split(np.arange(time_s.size), np.concatenate(cuts)[1:])
    unrolled = [_unrolled(time_s[of], place[of]) for of in rows if of.size >= FEWEST]
    found = [of for of in unrolled if of is not None]
    chosen = sorted((found[i] for i in rng.permutation(len(found))[:n_most]), key=len, reverse=True)
    columns = np.zeros((3, len(chosen), LONGEST))
    for i, of in enumerate(chosen):
        columns[:, i, : len(of)] = of.T
    return Pieces(columns[0], columns[1], columns[2], np.array([len(of) for of in chosen], np.int64))


def _strays(vehicle: IntArray, time_s: FloatArray, place: FloatArray) -> BoolArray:
    """(n,) detections far from where their neighbours in time put them; the worst of three, as one moves the others."""
    before, after = time_s[1:-1] - time_s[:-2], time_s[2:] - time_s[1:-1]
    inner = (vehicle[2:] == vehicle[:-2]) & (before + after <= 2.0 * LONGEST_PAUSE_S)
    share = (after / np.where(inner, before + after, np.inf))[:, None]
    off = np.zeros(time_s.size)
    off[1:-1] = np.where(inner, np.hypot(*(place[1:-1] - share * place[:-2] - (1.0 - share) * place[2:]).T), 0.0)
    usual = MAD * float(np.median(off[1:-1][inner])) if inner.any() else 0.0
    around = np.maximum(np.append(off[1:], 0.0), np.append(0.0, off[:-1]))
    return np.asarray((off > STRAYS * max(usual, 1e-3)) & (off >= around))


def _unrolled(time_s: FloatArray, place: FloatArray) -> FloatArray | None:
    """(n, 3) steps in seconds, metres along and across: steps turned by the smooth way's course; None if it stands."""
    middle = 0.5 * (time_s[0] + time_s[-1])
    degree = int(np.clip(round((time_s[-1] - time_s[0]) / BEND_S), 1, MOST_BENDS))
    way = np.polynomial.polynomial.polyfit(time_s - middle, place, degree)
    slope = np.polynomial.polynomial.polyder(way)
    between = 0.5 * (time_s[1:] + time_s[:-1]) - middle
    velocity = np.polynomial.polynomial.polyval(between, slope).T
    speed = np.hypot(*velocity.T)
    if speed.min() < MOVING_FROM:
        return None
    unit, moved = velocity / speed[:, None], np.diff(place, axis=0)
    along, across = (moved * unit).sum(axis=1), unit[:, 0] * moved[:, 1] - unit[:, 1] * moved[:, 0]
    steps = np.column_stack([np.diff(time_s), np.cumsum(along), np.cumsum(across)])
    return np.concatenate([np.zeros((1, 3)), steps])
