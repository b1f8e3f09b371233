"""Steps of vehicles on the lattice: what each was doing a step before, here, and a step after.

A step lasts as long as the rows are apart that learning keeps of a log: of 10 Hz 0.2 s, of 2 Hz 0.5 s.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, Self
from zlib import crc32

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _sorting
from dirprim_filter.primitives.visits import LONGEST_GAP_S, between
from dirprim_filter.store.lattice import NONE, Lattice, packed, unpacked
from dirprim_filter.store.tallies import Tally, ranked
from dirprim_filter.track_ids import world_names
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


class _Rows(NamedTuple):
    """The rows of some vehicles, in order of vehicle and time."""

    vehicle: IntArray
    time_ns: IntArray
    begins: BoolArray  # where a segment does: a vehicle's rows without a long gap
    position: FloatArray
    direction: FloatArray
    speed: FloatArray


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
        cuts = start[:-1][np.diff(start[:-1] // BLOCK_ROWS, prepend=-1) > 0]
        blocks = [order[a:b] for a, b in pairwise([*cuts.tolist(), order.size])]
        begins = [_begins(vehicle[rows], tracks.time_ns[rows]) for rows in blocks]
        gaps = [np.diff(tracks.time_ns[rows])[~new[1:]] for rows, new in zip(blocks, begins, strict=True)]
        ticks = _ticks_of(np.concatenate([np.empty(0, np.int64), *gaps]))
        del gaps
        for rows, new in zip(blocks, begins, strict=True):
            ordered = _Rows(
                vehicle[rows], tracks.time_ns[rows], new, tracks.position[rows], tracks.direction[rows],
                tracks.speed[rows],
            )  # fmt: skip
            yield cls._of(ordered, ticks)

    @classmethod
    def _of(cls, rows: _Rows, ticks: int) -> Self:
        """By Hermite splines between rows."""
        time, step = rows.time_ns, ticks * TICK_NS
        first = np.flatnonzero(rows.begins)
        last = np.append(first[1:], time.size)[: first.size] - 1
        n = (time[last] - time[first]) // step + 1
        segment = np.repeat(np.arange(first.size), n)
        number = np.arange(segment.size) - np.repeat(np.cumsum(n) - n, n)
        # Segments one after the other on one axis of time, so that all are found in one search.
        begin = np.cumsum(np.append(0, time[last] - time[first] + 1))[:-1]
        on_axis = time - np.repeat(time[first] - begin, last - first + 1)
        since = number * step
        row = np.searchsorted(on_axis, begin[segment] + since, side="right") - 1
        row = np.maximum(np.minimum(row, last[segment] - 1), first[segment])
        following = np.minimum(row + 1, last[segment])
        width = (time[following] - time[row]) * 1e-9
        share = np.where(width > 0, (since - (time[row] - time[first[segment]])) * 1e-9 / np.maximum(width, 1e-9), 0.0)
        position, direction, speed = between(rows, row, following, share, width)
        hour = (time[first] // HOUR_NS)[segment]
        return cls(number == 0, rows.vehicle[row], position, direction, speed, hour, ticks)


def _begins(vehicle: IntArray, time_ns: IntArray) -> BoolArray:
    """(n,) where a segment begins."""
    begins = np.ones(time_ns.size, np.bool_)
    begins[1:] = (np.diff(vehicle) != 0) | (np.diff(time_ns) > int(LONGEST_GAP_S * 1e9))
    return begins


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


def tally_steps(tracks: Tracks, lattice: Lattice) -> tuple[Tally, Tally]:
    """What a recording's vehicles did from step to step, and how many vehicles passed each place each way.

    Returns:
        `Summary.steps` and `Summary.passed`.
    """
    fold = _folds(tracks, lattice.n_folds)
    blocks, passed = [], [Tally.none(1, 1)]
    for seen in Instants.blocks(tracks):
        here, parts = lattice.states(seen.position, seen.direction, seen.speed)
        when = packed_when(seen.hour, fold[seen.vehicle], seen.ticks, lattice)
        blocks.append((when, here, seen.begins, np.column_stack(parts).astype(np.int16)))
        passed.append(_passed(passed_place(here, lattice), seen.vehicle))
    if not blocks:
        return Tally.none(4, 9), passed[0]
    when, here, begins, part = (np.concatenate(column) for column in zip(*blocks, strict=True))
    value = np.column_stack([np.ones(len(part), np.int16), part, part * part])
    return tally_in_order(when, here, begins, value), Tally.total(passed)


def tally_in_order(when: IntArray, here: IntArray, begins: BoolArray, value: IntArray) -> Tally:
    """The sums of steps that follow each other until one begins anew; by the ranks of their states, which sort faster.

    (n,), (n,), (n,), (n, v).
    """
    state, rank = ranked(here)
    before, after = np.where(begins, NONE, np.roll(rank, 1)), np.where(np.roll(begins, -1), NONE, np.roll(rank, -1))
    by_rank = Tally.of(np.column_stack([when, before, rank, after]), value)
    state = np.append(state, NONE)  # which is -1, the place of the last
    return Tally(key=np.column_stack([by_rank.key[:, 0], state[by_rank.key[:, 1:]]]), value=by_rank.value)


def _passed(place: IntArray, vehicle: IntArray) -> Tally:
    """How many vehicles were at each place."""
    once = Tally.of(np.column_stack([place, vehicle]), np.ones((place.size, 1), np.int16))
    return Tally.of(once.key[:, :1], np.ones((len(once), 1), np.int16))


def passed_place(state: IntArray, lattice: Lattice) -> IntArray:
    """(n,) the place and way by which vehicles of states are counted."""
    square, turn, pace = unpacked(state)
    way = np.where(pace == 0, PASSED_WAYS, turn * PASSED_WAYS // lattice.n_directions)
    return packed(square // PASSED_SQUARES, way, np.zeros_like(way))


def _folds(tracks: Tracks, n_folds: int) -> IntArray:
    """(n_tracks,) the fold of each vehicle, by its name: the same whichever others there are."""
    vehicle = tracks.vehicle
    row = np.empty(int(vehicle.max(initial=-1)) + 1, np.int64)
    row[vehicle] = np.arange(vehicle.size)
    names = world_names(tracks.track_id[row], tracks.group[row])
    return np.array([crc32(name.encode()) % n_folds for name in names.tolist()], np.int64)
