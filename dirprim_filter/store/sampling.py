"""Vehicles drawn with a known probability, so many of each turn, and weighed by its inverse.

Source: Horvitz and Thompson, A generalization of sampling without replacement from a finite universe, 1952.

Vehicles that come from the same square and go to the same one are one *turn*. Of a turn at most so many are kept as
fit, by a number that each vehicle has for good: which they are depends neither on order nor on other turns. A turn
that few vehicles take is kept whole beside a street with thousands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from datetime import datetime
from typing import NamedTuple, Self
from zoneinfo import ZoneInfo

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.tracks import Tracks

MOST_ROWS = 500_000
"""Learned from at once: 28 hours of driving."""
SLACK = 2
"""Times as many rows are held while it is not known yet how many of a turn fit."""
MOST_OF_A_TURN = 1 << 20
SQUARE_M = 32.0
"""Of the squares that vehicles come from and go to."""
SUPPORT_M, SUPPORT_COURSES = 8.0, 8
"""Side of the squares, and number of the courses, that vehicles are counted in for the minimum support."""
QUARTER_S = 900
"""Of an hour: clocks of all zones differ by some of these."""


class Recording(NamedTuple):
    """StoredRows of a recording."""

    name: str  # `StoredRows.digest`
    rows: StoredRows


class Ageing(NamedTuple):
    """How older vehicles count less."""

    half_life_s: float
    now_ms: int

    def weight(self, t_ms: IntArray) -> FloatArray:
        """(n,) of vehicles that came at times (n,): half after each half-life, in full if they are yet to come."""
        age_s = np.maximum(self.now_ms - t_ms, 0) * 1e-3
        return np.asarray(np.maximum(0.5 ** (age_s / self.half_life_s), 1e-6))


class Hours(NamedTuple):
    """A part of the day: vehicles that come in it count, others do not."""

    first: int  # a full hour by the clocks of the zone
    last: int  # not in it any more; before `first` where midnight is in it
    zone: str

    @classmethod
    def parse(cls, text: str, zone: str) -> Self:
        """Of a text such as 7-10.

        Raises:
            ValueError: it is no part of a day, or there is no such zone.
        """
        first, _, last = text.partition("-")
        if not (first.isdecimal() and last.isdecimal() and max(int(first), int(last)) <= 24):
            raise ValueError(f"--hours: expected full hours such as 7-10 or 22-5, got {text!r}")
        try:
            ZoneInfo(zone)
        except (ValueError, OSError, KeyError) as error:  # ZoneInfoNotFoundError is a KeyError
            raise ValueError(f"--zone: expected a time zone such as Europe/Berlin, got {zone!r}") from error
        return cls(int(first), int(last), zone)

    def of(self, rows: StoredRows) -> StoredRows:
        """Those of the vehicles that come in these hours."""
        first, clocks = rows.first, ZoneInfo(self.zone)
        quarter, at = np.unique(rows.t_ms[first] // (1000 * QUARTER_S), return_inverse=True)
        hour = np.array([datetime.fromtimestamp(q * QUARTER_S, clocks).hour for q in quarter.tolist()], np.int64)
        lasts = (self.last - self.first) % 24 or 24
        inside = ((hour - self.first) % 24 < lasts)[at]
        return rows.some(np.repeat(inside, np.diff(np.append(first, len(rows)))))


class Sample(NamedTuple):
    """What is learned from."""

    tracks: Tracks
    weight: FloatArray  # (n_tracks,)
    n_vehicles: int  # of which they were drawn


class _Part(NamedTuple):
    """What is left of a recording."""

    recording: Recording
    turn: IntArray  # (n_vehicles,)
    number: FloatArray  # (n_vehicles,) in [0, 1)

    @classmethod
    def of(cls, recording: Recording) -> _Part:
        """All of it."""
        return cls(recording, _turns(recording.rows), _numbers(recording))

    def some(self, kept: BoolArray) -> _Part:
        """Some vehicles."""
        rows = self.recording.rows
        of_row = np.repeat(kept, np.diff(np.append(rows.first, len(rows))))
        return _Part(self.recording._replace(rows=rows.some(of_row)), self.turn[kept], self.number[kept])


def drawn(recordings: Iterable[Recording], *, most_rows: int = MOST_ROWS) -> tuple[list[Recording], int]:
    """At most so many rows of vehicles, weighed by how many each stands for.

    Args:
        recordings: each once, in any order; read one after the other.
        most_rows: to keep.

    Returns:
        Recordings in the order of their names, and how many vehicles there were.
    """
    parts: list[_Part] = []
    n_of = Counter[int]()
    most, held = MOST_OF_A_TURN, 0
    for recording in recordings:
        n_of.update(turns_in(recording.rows))
        parts.append(_Part.of(recording))
        held += len(recording.rows)
        while held > SLACK * most_rows and most > 1:
            most //= 2
            parts, held = _thinned(parts, n_of, most)
    parts, held = _thinned(parts, n_of, most)
    while held > most_rows and most > 1:
        most //= 2
        parts, held = _thinned(parts, n_of, most)
    parts.sort(key=lambda part: part.recording.name)
    return [_weighed(part, n_of, most) for part in parts], sum(n_of.values())


def kept_of(rows: StoredRows, name: str, n_of: dict[int, int], most: int) -> StoredRows:
    """Of a recording, the vehicles that are drawn where `n_of` take each turn in all, weighed; see `turns_in`."""
    (part,), _ = _thinned([_Part.of(Recording(name, rows))], n_of, most)
    return _weighed(part, n_of, most).rows


def turns_in(rows: StoredRows) -> dict[int, int]:
    """How many vehicles take each turn."""
    turn, n = np.unique(_turns(rows), return_counts=True)
    return dict(zip(turn.tolist(), n.tolist(), strict=True))


def sample_of(recordings: list[Recording], n_vehicles: int, *, min_vehicles: int, ageing: Ageing | None) -> Sample:
    """As learning takes them.

    Args:
        recordings: see `drawn`.
        n_vehicles: of which they were drawn.
        min_vehicles: rows where fewer vehicles passed the same way are left out.
        ageing: how older ones count less; None where all count alike.
    """
    tracks, weights, before, group = [], [], 0, 0
    for _, rows in recordings:
        if not len(rows):
            continue
        first, n = rows.first, np.diff(np.append(rows.first, len(rows)))
        _, own_group = np.unique(rows.group, return_inverse=True)
        tracks.append(rows.tracks(before + np.repeat(np.arange(n.size), n), group + own_group))
        weights.append(rows.weight[first] * (1.0 if ageing is None else ageing.weight(rows.t_ms[first])))
        before, group = before + n.size, group + int(own_group.max()) + 1
    if not tracks:
        return Sample(Tracks.none(), np.empty(0), n_vehicles)
    together, weight = Tracks.concatenate(tracks), np.concatenate(weights)
    if min_vehicles > 1:
        counted = np.concatenate([rows.weight[rows.first] for _, rows in recordings])
        supported = _supported(together, counted, min_vehicles)
        weight = weight[np.unique(together.track_id[supported])]
        together = together[supported]
    return Sample(together, weight, n_vehicles)


def _supported(tracks: Tracks, weight: FloatArray, least: int) -> BoolArray:
    """(n,) rows where so many vehicles passed the same way, by weight (n_tracks,)."""
    course = np.floor((tracks.direction / (2.0 * np.pi) * SUPPORT_COURSES + 0.5) % SUPPORT_COURSES)
    way = np.column_stack([np.floor(tracks.position / SUPPORT_M), course]).astype(np.int64)
    _, way_of = np.unique(way, axis=0, return_inverse=True)
    passed = np.unique(np.column_stack([way_of, tracks.track_id]), axis=0)
    n = np.bincount(passed[:, 0], weight[passed[:, 1]])
    return np.asarray(n[way_of] >= least - 1e-3)  # weights have seven digits


def _turns(rows: StoredRows) -> IntArray:
    """(n_vehicles,) a number of the squares that each comes from and goes to."""
    if not len(rows):
        return np.empty(0, np.int64)
    first = rows.first
    last = np.append(first[1:], len(rows)) - 1
    square = np.floor(rows.position / SQUARE_M).astype(np.int64)
    number: UIntArray = np.zeros(first.size, np.uint64)
    for column in (*square[first].T, *square[last].T):
        number = _mixed(number ^ column.astype(np.uint64))
    return number.astype(np.int64)


def _numbers(recording: Recording) -> FloatArray:
    """(n_vehicles,) uniform in [0, 1), each vehicle's for good."""
    rows = recording.rows
    seed, track = np.uint64(int(recording.name[:16], 16)), rows.track[rows.first].astype(np.uint64)
    number = (_mixed(_mixed(track) ^ seed) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return number * rows.weight[rows.first]  # who was drawn before is among those below the inverse of its weight


def _mixed(number: UIntArray) -> UIntArray:
    """The finaliser of SplitMix64 (Steele, Lea and Flood 2014). (n,) uint64."""
    with np.errstate(over="ignore"):
        one = number + np.uint64(0x9E3779B97F4A7C15)
        two = (one ^ (one >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        three = (two ^ (two >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(three ^ (three >> np.uint64(31)), np.uint64)


def _shares(part: _Part, n_of: dict[int, int], most: int) -> FloatArray:
    """(n_vehicles,) with which probability each is kept."""
    n = np.array([n_of[turn] for turn in part.turn.tolist()], np.float64)
    return np.asarray(np.minimum(1.0, most / np.maximum(n, 1.0)))


def _thinned(parts: list[_Part], n_of: dict[int, int], most: int) -> tuple[list[_Part], int]:
    """Those vehicles that are kept if at most so many of a turn are, and how many rows they have."""
    left = [part.some(part.number < _shares(part, n_of, most)) for part in parts]
    return left, sum(len(part.recording.rows) for part in left)


def _weighed(part: _Part, n_of: dict[int, int], most: int) -> Recording:
    rows = part.recording.rows
    share = np.repeat(_shares(part, n_of, most), np.diff(np.append(rows.first, len(rows))))
    return part.recording._replace(rows=replace(rows, weight=rows.weight / share))
