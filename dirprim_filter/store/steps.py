"""Steps of vehicles on the lattice: what each was doing a step before, here, and a step after.

A step lasts as long as the rows are apart that learning keeps of a log: of 10 Hz 0.2 s, of 2 Hz 0.5 s.
"""

from __future__ import annotations

from typing import NamedTuple, Self
from zlib import crc32

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives import _sorting
from dirprim_filter.primitives.visits import LONGEST_GAP_S, between
from dirprim_filter.store.lattice import NONE, Lattice, packed, unpacked
from dirprim_filter.store.tallies import Tally
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
EARLY = 0.1
"""Learning keeps a row that comes too early by this share of its interval."""


class _Rows(NamedTuple):
    """Some rows of tracks: of a log of 10 Hz few are needed."""

    position: FloatArray
    direction: FloatArray
    speed: FloatArray

    @classmethod
    def of(cls, tracks: Tracks, rows: IntArray) -> Self:
        return cls(tracks.position[rows], tracks.direction[rows], tracks.speed[rows])


class Instants(NamedTuple):
    """Vehicles at steps from the first row of each segment on; a segment is a vehicle's rows without a long gap."""

    segment: IntArray  # (n,) ascending
    vehicle: IntArray  # (n,)
    position: FloatArray  # (n, 2) metres
    direction: FloatArray  # (n,) radians
    speed: FloatArray  # (n,) m/s
    hour: IntArray  # (n,) since 1970-01-01, in which the segment begins
    first_row: IntArray  # (n_tracks,) of the tracks, of each vehicle
    ticks: int  # `TICK_NS` from one instant to the next

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """The vehicles of tracks at every step, by Hermite splines between their rows."""
        vehicle = tracks.vehicle
        n_vehicles = int(vehicle.max(initial=-1)) + 1
        start = np.empty(n_vehicles + 1, np.int64)
        order = _sorting.sort_by(vehicle, n_vehicles, start)
        time, who = tracks.time_ns[order], vehicle[order]
        begins = np.ones(time.size, np.bool_)
        begins[1:] = (np.diff(who) != 0) | (np.diff(time) > int(LONGEST_GAP_S * 1e9))
        first = np.flatnonzero(begins)
        last = np.append(first[1:], time.size)[: first.size] - 1
        ticks = _ticks_of(np.diff(time)[~begins[1:]])
        step = ticks * TICK_NS
        n = (time[last] - time[first]) // step + 1
        segment = np.repeat(np.arange(first.size), n)
        since = (np.arange(segment.size) - np.repeat(np.cumsum(n) - n, n)) * step
        # Segments one after the other on one axis of time, so that all are found in one search.
        begin = np.cumsum(np.append(0, time[last] - time[first] + 1))[:-1]
        on_axis = time - time[first][np.cumsum(begins) - 1] + begin[np.cumsum(begins) - 1]
        row = np.searchsorted(on_axis, begin[segment] + since, side="right") - 1
        row = np.maximum(np.minimum(row, last[segment] - 1), first[segment])
        following = np.minimum(row + 1, last[segment])
        width = (time[following] - time[row]) * 1e-9
        share = np.where(width > 0, (since - (time[row] - time[first[segment]])) * 1e-9 / np.maximum(width, 1e-9), 0.0)
        used = np.zeros(time.size, np.bool_)
        used[row] = used[following] = True
        place = np.cumsum(used) - 1
        position, direction, speed = between(_Rows.of(tracks, order[used]), place[row], place[following], share, width)
        hour = (time[first] // HOUR_NS)[segment]
        return cls(segment, who[row], position, direction, speed, hour, order[start[:-1]], ticks)


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
    seen = Instants.of(tracks)
    here, parts = lattice.states(seen.position, seen.direction, seen.speed)
    same = seen.segment[1:] == seen.segment[:-1]
    before, after = np.full(here.size, NONE), np.full(here.size, NONE)
    before[1:][same], after[:-1][same] = here[:-1][same], here[1:][same]
    fold = _folds(tracks, seen.first_row, lattice.n_folds)[seen.vehicle]
    when = packed_when(seen.hour, fold, seen.ticks, lattice)
    steps = Tally.of(
        np.column_stack([when, before, here, after]),
        np.column_stack([np.ones(here.size, np.int64), *parts, *(part * part for part in parts)]),
    )
    return steps, _passed(passed_place(here, lattice), seen.vehicle)


def _passed(place: IntArray, vehicle: IntArray) -> Tally:
    """How many vehicles were at each place."""
    order = np.lexsort((vehicle, place))
    place, vehicle = place[order], vehicle[order]
    is_new = np.append(True, (np.diff(place) != 0) | (np.diff(vehicle) != 0))[: place.size]
    return Tally.of(place[is_new][:, None], np.ones((int(is_new.sum()), 1), np.int64))


def passed_place(state: IntArray, lattice: Lattice) -> IntArray:
    """(n,) the place and way by which vehicles of states are counted."""
    square, turn, pace = unpacked(state)
    way = np.where(pace == 0, PASSED_WAYS, turn * PASSED_WAYS // lattice.n_directions)
    return packed(square // PASSED_SQUARES, way, np.zeros_like(way))


def _folds(tracks: Tracks, first: IntArray, n_folds: int) -> IntArray:
    """(n_tracks,) the fold of each vehicle, by its name: the same whichever others there are."""
    names = world_names(tracks.track_id[first], tracks.group[first])
    return np.array([crc32(name.encode()) % n_folds for name in names.tolist()], np.int64)
