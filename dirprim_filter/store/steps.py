"""Steps of vehicles on the lattice: what each was doing a step before, here, and a step after.

A step lasts as long as the rows are apart that learning keeps of a log: of 10 Hz 0.2 s, of 2 Hz 0.5 s.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _sorting
from dirprim_filter.primitives._filling import at_steps, time_to_next
from dirprim_filter.primitives.visits import LONGEST_GAP_NS
from dirprim_filter.store.lattice import NONE, Lattice, packed, unpacked
from dirprim_filter.store.tallies import Tally, ranked, summed_by
from dirprim_filter.tracks import Tracks

HOUR_NS = 3600 * 10**9
WHEN, BEFORE, HERE, AFTER = range(4)
"""Columns of a step's key."""
PASSED_SQUARES = 8
"""Vehicles are counted by squares of so many of the lattice's each way."""
PASSED_WAYS = 8
"""And by so many directions; one more is for those that stand."""
TICK_NS = 50_000_000
"""Steps last whole multiples of it, so that recordings of one rate add up however their clocks jitter."""
N_TICKS = 1 << 6
"""Steps are shorter than so many."""
BLOCK_ROWS = 1 << 16
"""At a time are brought to steps: what is made of them fits into a core's cache."""
EARLY = 0.1
"""Learning keeps a row that comes too early by this share of its interval."""


class Instants(NamedTuple):
    """Vehicles at steps from the first row of each segment on."""

    begins: BoolArray  # (n,) where a segment begins
    vehicle: IntArray  # (n,)
    position: FloatArray  # (n, 2) metres
    direction: FloatArray  # (n,) radians
    speed: FloatArray  # (n,) m/s
    hour: IntArray  # (n,) since 1970-01-01, in which the segment begins
    ticks: int  # `TICK_NS` from one instant to the next

    @classmethod
    def blocks(cls, tracks: Tracks) -> Iterator[Self]:
        """The vehicles of tracks at every step, those of some vehicles at a time."""
        vehicle = tracks.vehicle
        start = np.empty(int(vehicle.max(initial=-1)) + 2, np.int64)
        order = _sorting.sort_by(vehicle, start.size - 1, start)
        apart = time_to_next(order, vehicle, tracks.time_ns, LONGEST_GAP_NS)
        ticks = _ticks_of(apart[apart >= 0])
        cuts = start[:-1][np.diff(start[:-1] // BLOCK_ROWS, prepend=-1) > 0]
        for a, b in pairwise([*cuts.tolist(), order.size]):
            row, first, state = at_steps(
                order[a:b], apart[a:b], tracks.position, tracks.direction, tracks.speed, ticks * TICK_NS
            )
            begins = np.append(True, (first[1:] != first[:-1]))[: first.size]
            hour = (tracks.time_ns[first[begins]] // HOUR_NS)[np.cumsum(begins) - 1]
            yield cls(begins, vehicle[row], state[:, :2], state[:, 2], state[:, 3], hour, ticks)


def _ticks_of(apart_ns: IntArray) -> int:
    """How long a step is where rows of a vehicle are so far apart, (n,) nanoseconds, mostly."""
    wanted_ns = LearningConfig().row_interval_s * 1e9
    row_ns = float(np.median(apart_ns)) if apart_ns.size else wanted_ns
    every = max(np.ceil(wanted_ns * (1.0 - EARLY) / row_ns - 1e-9), 1.0)
    return int(np.clip(round(every * row_ns / TICK_NS), 1, N_TICKS - 1))


def packed_when(hour: IntArray, fold: IntArray, ticks: IntArray | int, lattice: Lattice) -> IntArray:
    """The first column of a step's key: when its vehicle came into sight, its fold, and how long its steps are."""
    return (hour * lattice.n_folds + fold) * N_TICKS + ticks


def unpacked_when(when: IntArray, lattice: Lattice) -> tuple[IntArray, IntArray, IntArray]:
    """Hour, fold and ticks."""
    return when // (lattice.n_folds * N_TICKS), when // N_TICKS % lattice.n_folds, when % N_TICKS


def tally_steps(tracks: Tracks, lattice: Lattice, fold: IntArray) -> tuple[Tally, Tally]:
    """What a recording's vehicles did from step to step, and how many vehicles passed each place each way.

    Args:
        tracks: of the recording.
        lattice: that is counted on.
        fold: (n_tracks,) of each vehicle, see `folds_of`.

    Returns:
        `Summary.steps` and `Summary.passed`.
    """
    blocks, passed = [], [Tally.none(1, 1)]
    for seen in Instants.blocks(tracks):
        here, parts = lattice.states(seen.position, seen.direction, seen.speed)
        when = packed_when(seen.hour, fold[seen.vehicle], seen.ticks, lattice)
        blocks.append((when, here, seen.begins, np.array(parts, np.int16).T))
        passed.append(_passed(passed_place(here, lattice), seen.vehicle))
    if not blocks:
        return Tally.none(4, 9), passed[0]
    when, here, begins, part = (np.concatenate(column) for column in zip(*blocks, strict=True))
    value = np.empty((len(part), 9), np.int16)
    value[:, 0], value[:, 1:5], value[:, 5:] = 1, part, part * part
    return tally_in_order(when, here, begins, value), Tally.total(passed)


def tally_in_order(when: IntArray, here: IntArray, begins: BoolArray, value: AnyArray) -> Tally:
    """The sums of steps that follow each other until one begins anew; by the ranks of their states, which sort faster.

    (n,), (n,), (n,), (n, v).
    """
    rank, ends = ranked(here), np.roll(begins, -1)
    before, after = np.where(begins, NONE, np.roll(rank, 1)), np.where(ends, NONE, np.roll(rank, -1))
    row, total = summed_by((when, before, rank, after), value)
    next_row = np.where(row + 1 < here.size, row + 1, 0)
    key = (when[row], np.where(begins[row], NONE, here[row - 1]), here[row], np.where(ends[row], NONE, here[next_row]))
    return Tally(key=np.column_stack(key), value=total)


def _passed(place: IntArray, vehicle: IntArray) -> Tally:
    """How many vehicles were at each place."""
    moves = np.append(True, (place[1:] != place[:-1]) | (vehicle[1:] != vehicle[:-1]))[: place.size]
    place = place[moves]
    row, _ = summed_by((place, vehicle[moves]), np.ones((place.size, 1), np.int16))  # of each vehicle once, by places
    first = np.flatnonzero(np.diff(place[row], prepend=-1))
    return Tally(key=place[row[first], None], value=np.diff(first, append=row.size)[:, None])


def passed_place(state: IntArray, lattice: Lattice) -> IntArray:
    """(n,) the place and way by which vehicles of states are counted."""
    east, north, turn, pace = unpacked(state)
    way = np.where(pace == 0, PASSED_WAYS, turn * PASSED_WAYS // lattice.n_directions)
    return packed(east // PASSED_SQUARES, north // PASSED_SQUARES, way, np.zeros_like(way))
