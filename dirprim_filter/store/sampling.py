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
from dirprim_filter.distributions._random import UIntArray, mixed
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
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""From one state of splitmix64 to the next."""


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
        if not (first.isdecimal() and last.isdecimal() and int(first) < 24 >= int(last) != int(first)):
            raise ValueError(f"--hours: expected full hours such as 7-10 or 22-5, or 0-24 for all, got {text!r}")
        try:
            ZoneInfo(zone)
        except (ValueError, OSError, KeyError) as error:  # ZoneInfoNotFoundError is a KeyError
            raise ValueError(f"--zone: expected a time zone such as Europe/Berlin, got {zone!r}") from error
        return cls(int(first), int(last), zone)

    def of(self, rows: StoredRows) -> StoredRows:
        """Those of the vehicles that come in these hours."""
        clocks = ZoneInfo(self.zone)
        quarter, at = np.unique(rows.t_ms[rows.first] // (1000 * QUARTER_S), return_inverse=True)
        hour = np.array([datetime.fromtimestamp(q * QUARTER_S, clocks).hour for q in quarter.tolist()], np.int64)
        lasts = (self.last - self.first) % 24 or 24
        inside = ((hour - self.first) % 24 < lasts)[at]
        return rows.some(inside[rows.vehicle])


class Recording(NamedTuple):
    """Vehicles of a recording, of whom some are drawn."""

    name: str  # `StoredRows.digest` of all
    rows: StoredRows
    turn: IntArray  # (n_vehicles,)
    number: FloatArray  # (n_vehicles,) in [0, 1)

    @classmethod
    def of(cls, name: str, rows: StoredRows) -> Self:
        """All that the store has of it."""
        seed, track = np.uint64(int(name[:16], 16)), rows.track[rows.first].astype(np.uint64)
        number = (_mixed(_mixed(track) ^ seed) >> np.uint64(11)).astype(np.float64) * 2.0**-53
        # Who was drawn before is among those below the inverse of its weight.
        return cls(name, rows, turns_of(rows), number * rows.weight[rows.first])

    def thinned(self, n_of: Counter[int], most: int) -> Self:
        """Those vehicles that are kept if at most so many of a turn are, of all that take it."""
        kept = self.number < self._shares(n_of, most)
        return self._replace(
            rows=self.rows.some(kept[self.rows.vehicle]), turn=self.turn[kept], number=self.number[kept]
        )

    def weighed(self, n_of: Counter[int], most: int) -> StoredRows:
        """The rows of those who were kept so, by how many each stands for."""
        share = self._shares(n_of, most)[self.rows.vehicle]
        return replace(self.rows, weight=self.rows.weight / share)

    def _shares(self, n_of: Counter[int], most: int) -> FloatArray:
        """(n_vehicles,) with which probability each is kept."""
        n = np.array([n_of[turn] for turn in self.turn.tolist()], np.float64)
        return np.asarray(np.minimum(1.0, most / np.maximum(n, 1.0)))


def drawn(recordings: Iterable[Recording], *, most_rows: int = MOST_ROWS) -> list[StoredRows]:
    """At most so many rows of vehicles, weighed by how many each stands for, in the order of the recordings' names.

    Args:
        recordings: each once, in any order; read one after the other.
        most_rows: to keep.
    """
    parts: list[Recording] = []
    n_of = Counter[int]()
    most, held = MOST_OF_A_TURN, 0
    for recording in recordings:
        n_of.update(recording.turn.tolist())
        parts.append(recording)
        held += len(recording.rows)
        while held > SLACK * most_rows and most > 1:
            most //= 2
            parts, held = _thinned(parts, n_of, most)
    parts, held = _thinned(parts, n_of, most)
    while held > most_rows and most > 1:
        most //= 2
        parts, held = _thinned(parts, n_of, most)
    return [part.weighed(n_of, most) for part in sorted(parts, key=lambda part: part.name)]


def _thinned(parts: list[Recording], n_of: Counter[int], most: int) -> tuple[list[Recording], int]:
    left = [part.thinned(n_of, most) for part in parts]
    return left, sum(len(part.rows) for part in left)


def sample_of(recordings: list[StoredRows], *, min_vehicles: int, ageing: Ageing | None) -> tuple[Tracks, FloatArray]:
    """As learning takes them: tracks, and (n_tracks,) their weights.

    Args:
        recordings: see `drawn`.
        min_vehicles: rows where fewer vehicles passed the same way are left out.
        ageing: how older ones count less; None where all count alike.
    """
    tracks, counted, weights, before, group = [Tracks.none()], [np.empty(0)], [np.empty(0)], 0, 0
    for rows in recordings:
        _, own_group = np.unique(rows.group, return_inverse=True)
        tracks.append(rows.tracks(before + rows.vehicle, group + own_group))
        counted.append(rows.weight[rows.first])
        weights.append(counted[-1] * (1.0 if ageing is None else ageing.weight(rows.t_ms[rows.first])))
        before, group = before + rows.first.size, group + int(own_group.max(initial=-1)) + 1
    together, weight = Tracks.concatenate(tracks), np.concatenate(weights)
    if min_vehicles > 1:
        supported = _supported(together, np.concatenate(counted), min_vehicles)
        weight = weight[np.unique(together.track_id[supported])]
        together = together[supported]
    return together, weight


def _supported(tracks: Tracks, weight: FloatArray, least: int) -> BoolArray:
    """(n,) rows where so many vehicles passed the same way, by weight (n_tracks,)."""
    course = np.floor((tracks.direction / (2.0 * np.pi) * SUPPORT_COURSES + 0.5) % SUPPORT_COURSES)
    way = np.column_stack([np.floor(tracks.position / SUPPORT_M), course]).astype(np.int64)
    _, way_of = np.unique(way, axis=0, return_inverse=True)
    passed = np.unique(np.column_stack([way_of, tracks.track_id]), axis=0)
    n = np.bincount(passed[:, 0], weight[passed[:, 1]])
    return np.asarray(n[way_of] >= least - 1e-3)  # weights have seven digits


def turns_of(rows: StoredRows) -> IntArray:
    """(n_vehicles,) a number of the squares that each comes from and goes to."""
    last = np.flatnonzero(np.diff(rows.track, append=-1))
    square = np.floor(rows.position / SQUARE_M).astype(np.int64)
    number: UIntArray = np.zeros(last.size, np.uint64)
    for column in (*square[rows.first].T, *square[last].T):
        number = _mixed(number ^ column.astype(np.uint64))
    return number.astype(np.int64)


def _mixed(number: UIntArray) -> UIntArray:
    """The next draw of splitmix64 from each state. (n,) uint64."""
    return np.asarray(mixed.py_func(number + GOLDEN), np.uint64)
