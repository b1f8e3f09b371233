"""Pseudo-vehicles of each recording by itself: which they are depends on no other recording.

Those of the sum of all recordings (see `learning.visible_tracks`) go on as any vehicle did that was at a place, so one
more recording may change them all. These are what parts of a map are fitted anew from.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import LONGEST_GAP_S
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.learning import GOLDEN, is_passed
from dirprim_filter.store.pseudo_tracks import APART_NS, pseudo_tracks
from dirprim_filter.store.steps import WHEN, unpacked_when
from dirprim_filter.store.store import Store
from dirprim_filter.store.table import read_summary
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tiles import Tile, tiles_at
from dirprim_filter.tracks import Tracks

WAYS_EACH = 1 << 32
"""More than a recording has."""


class WayRows(NamedTuple):
    """Rows of pseudo-vehicles, in order of their recordings, ways and times."""

    way: IntArray  # (n,) a number for each way of each recording
    time_ns: IntArray  # (n,) since the way began
    number: IntArray  # (n,) ascending: those that follow each other without a gap count up
    position: FloatArray  # (n, 2) metres
    direction: FloatArray  # (n,) radians
    speed: FloatArray  # (n,) m/s
    hour: IntArray  # (n,) since 1970-01-01, in which the way began
    rank: FloatArray  # (n,) of the way, see `rank_of`

    def some(self, rows: BoolArray) -> WayRows:
        """Those that are chosen, (n,)."""
        return WayRows(*(column[rows] for column in self))  # type: ignore[arg-type]

    def faded(self, share: float, fading: Fading) -> WayRows:
        """Of a share of the ways, those that their age leaves."""
        return self.some(self.rank < share * fading.share(self.hour))

    @classmethod
    def of(cls, store: Store, tiles: set[Tile], *, min_vehicles: int, share: float) -> WayRows:
        """Of some tiles, those rows where at least so many vehicles passed, of a share of the ways.

        Raises:
            RecordingError: a recording is damaged.
            OSError: one cannot be read.
        """
        lattice, wanted = store.config.lattice, _coded(np.array(sorted(tiles), np.int64).reshape(-1, 2))
        recorded = store.recorded()
        parts, passed = [WayRows.none()], Tally.none(1, 1)
        for i, rows in enumerate(sorted(recorded)):
            if not any((tile[0], tile[1]) in tiles for tile in recorded[rows]):
                continue
            summary = read_summary(store.recording(rows))
            tracks, kind = pseudo_tracks(summary.steps, lattice)
            hour, _, _ = unpacked_when(summary.steps.key[kind, WHEN], lattice)
            there = np.isin(_coded(tiles_at(tracks.position, lattice)), wanted)
            parts.append(_rows_of(tracks, hour, i, rows, there=there, share=share))
            passed = passed + summary.passed
        found = WayRows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        tracks = Tracks(
            track_id=found.way, time_ns=np.arange(found.way.size), position=found.position,
            direction=found.direction, speed=found.speed,
        )  # fmt: skip
        return found.some(is_passed(tracks, passed, lattice, min_vehicles)) if found.way.size else found

    @classmethod
    def none(cls) -> WayRows:
        """No row."""
        whole, floats = np.empty(0, np.int64), np.empty(0)
        return cls(whole, whole, whole, np.empty((0, 2)), floats, floats, whole, floats)


def _rows_of(
    tracks: Tracks, hour: IntArray, i: int, rows: str, *, there: BoolArray, share: float
) -> WayRows:  # fmt: skip
    """Those of recording number `i` that are `there`, (n,), and of a share of its ways."""
    way = tracks.track_id.astype(np.int64)
    begins = np.append(True, way[1:] != way[:-1])
    time_ns = tracks.time_ns - tracks.time_ns[begins][np.cumsum(begins) - 1]
    rank = rank_of(way, rows)
    kept = (rank < share) & there
    number = i * WAYS_EACH + np.arange(way.size)
    return WayRows(
        i * WAYS_EACH + way, time_ns, number, tracks.position, tracks.direction, tracks.speed, hour, rank
    ).some(kept)  # fmt: skip


def rank_of(way: IntArray, rows: str) -> FloatArray:
    """(n,) of ways of a recording, spread evenly from 0 to 1: of a share of them, those below it are taken. (n,)."""
    return np.asarray(((way + 1) * GOLDEN + int(rows[:8], 16) / (1 << 32)) % 1.0, np.float64)


def _coded(tile: IntArray) -> IntArray:
    """(n,) a number for each tile. (n, 2)."""
    return np.asarray(tile[:, 0] * (1 << 32) + tile[:, 1])


class Pieces(NamedTuple):
    """Rows of ways within a box, as learning takes them, and when the segments that it fills in begin."""

    rows: TrackRows
    way: IntArray  # (n_segments,)
    begin_ns: IntArray  # (n_segments,) since the way began
    hour: IntArray  # (n_vehicles,) since 1970-01-01, in which the way of each began

    @classmethod
    def of(cls, ways: WayRows, low: FloatArray, high: FloatArray) -> Self:
        """Of the box from `low` to `high`, (2,) metres each; nothing is filled in where a way leaves it."""
        inside = ways.some(np.asarray(((ways.position >= low) & (ways.position < high)).all(axis=1)))
        breaks = np.append(True, (np.diff(inside.number) != 1) | (np.diff(inside.way) != 0))[: inside.way.size]
        _, row, vehicle = np.unique(inside.way, return_index=True, return_inverse=True)
        time_ns = inside.time_ns + np.cumsum(breaks) * APART_NS
        apart = (np.diff(vehicle) != 0) | (np.diff((time_ns - time_ns[:1].sum()) * 1e-9) > LONGEST_GAP_S)
        first = np.append(0, np.flatnonzero(apart) + 1)[: inside.way.size]
        rows = TrackRows(
            vehicle=vehicle, time_ns=time_ns, position=inside.position, direction=inside.direction,
            speed=inside.speed, group=vehicle,
        )  # fmt: skip
        return cls(rows, inside.way[first], inside.time_ns[first], inside.hour[row])
