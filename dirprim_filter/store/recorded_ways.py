"""Pseudo-vehicles of each recording by itself: which they are depends on no other recording.

Those of the sum of all recordings (see `learning.visible_tracks`) go on as any vehicle did that was at a place, so one
more recording may change them all. These are what parts of a map are fitted anew from.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import LONGEST_GAP_NS
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import GOLDEN, Visible, is_passed
from dirprim_filter.store.pseudo_tracks import APART_NS, pseudo_tracks
from dirprim_filter.store.steps import WHEN, unpacked_when
from dirprim_filter.store.store import Store
from dirprim_filter.store.table import read_summary
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tiles import Whereabouts
from dirprim_filter.tracks import Tracks

WAYS_EACH = 1 << 32
"""More than a recording has."""
SUMMED_AT_ONCE = 100
"""Recordings, whose counts of vehicles wait to be summed."""


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

    def visible(self) -> Visible:
        """The same as vehicles, one after the other, apart in time wherever rows are left out."""
        breaks = (np.diff(self.number) != 1) | (np.diff(self.way) != 0)
        time_ns = np.append(0, np.cumsum(np.where(breaks, APART_NS, np.diff(self.time_ns))))[: self.way.size]
        tracks = Tracks(
            track_id=self.way, time_ns=time_ns, position=self.position, direction=self.direction, speed=self.speed
        )
        return Visible(tracks, self.hour[np.unique(self.way, return_index=True)[1]])

    @classmethod
    def together(cls, parts: Sequence[WayRows]) -> WayRows:
        """Of places that do not overlap."""
        if len(parts) == 1:
            return parts[0]
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        order = np.argsort(columns[2])  # by number
        return cls(*(column[order] for column in columns))

    @classmethod
    def none(cls) -> WayRows:
        """No row."""
        whole, floats = np.empty(0, np.int64), np.empty(0)
        return cls(whole, whole, whole, np.empty((0, 2)), floats, floats, whole, floats)


class Box(NamedTuple):
    """Ground that is learned from."""

    low: FloatArray  # (2,) metres
    high: FloatArray  # (2,)
    fading: Fading | None  # by which ways are left out


EVERYWHERE = Box(np.full(2, -np.inf), np.full(2, np.inf), None)


class Sample(NamedTuple):
    """What is learned from of a box."""

    ways: WayRows
    share: float  # of the ways, beside what age leaves


def recordings_at(boxes: Sequence[Box], there: Whereabouts, lattice: Lattice) -> list[tuple[int, str]]:
    """Number and name of the recordings that boxes are learned from."""
    return sorted({near for box in boxes for near in there.near(box.low, box.high, lattice)})


def sampled(
    store: Store, boxes: Sequence[Box], *, most_rows: int, min_vehicles: int,
    recordings: Sequence[tuple[int, str]] | None = None,
) -> Iterator[Sample]:  # fmt: skip
    """The rows in boxes where at least so many vehicles passed: of all ways or, where they are many, of a share.

    The share is the largest power of a half that leaves no more rows than `most_rows`: it depends on the recordings
    that have steps in the tiles of the box, and on nothing else. Recordings are read once for all boxes, and rows in
    several of them held once.

    Args:
        store: of recordings.
        boxes: of ground.
        most_rows: of each.
        min_vehicles: that passed a place the same way, at least.
        recordings: as of `recordings_at`; left out, they are looked up.

    Raises:
        RecordingError: a recording is damaged.
        OSError: one cannot be read.
    """
    lattice, gathered, passed = store.config.lattice, _Gathered(boxes, most_rows), [Tally.none(1, 1)]
    if recordings is None:
        recordings = recordings_at(boxes, Whereabouts.of_all(store.recorded()), lattice)
    for i, rows in recordings:
        summary = read_summary(store.recording(rows))
        gathered.add(_rows_of(summary.steps, lattice, i, rows))
        passed.append(summary.passed)
        if len(passed) > SUMMED_AT_ONCE:
            passed = [Tally.total(passed)]
    by_place = Tally.total(passed)
    return (gathered.sample(k, by_place, lattice, min_vehicles) for k in range(len(boxes)))


class _Gathered:
    """Rows in boxes, of ever fewer ways as there are more."""

    def __init__(self, boxes: Sequence[Box], most_rows: int) -> None:
        self._boxes, self._most = boxes, most_rows
        self._parts, self._n_held, self._n_needed = [WayRows.none()], 0, 0
        self._n, self._share = np.zeros(len(boxes), np.int64), np.ones(len(boxes))

    def add(self, ways: WayRows) -> None:
        needed = np.zeros(ways.way.size, np.bool_)
        for k in range(len(self._boxes)):
            taken = self._taken(ways, k)
            self._n[k] += np.count_nonzero(taken)
            needed |= taken
        self._parts.append(ways.some(needed))
        self._n_held += self._parts[-1].way.size
        for k in np.flatnonzero(self._n > self._most).tolist():
            while self._n[k] > self._most:
                self._share[k] *= 0.5
                self._n[k] = sum(np.count_nonzero(self._taken(part, k)) for part in self._parts)
        if self._n_held > min(2 * max(self._n_needed, self._most), self._n.sum()):
            self._drop()

    def _drop(self) -> None:
        """What no box takes any more."""
        for i, part in enumerate(self._parts):  # in place, lest there be two of all
            self._parts[i] = part.some(np.logical_or.reduce([self._taken(part, k) for k in range(len(self._boxes))]))
        self._n_held = self._n_needed = sum(part.way.size for part in self._parts)

    def _taken(self, ways: WayRows, k: int) -> BoolArray:
        """(n,) rows of the k-th box."""
        box = self._boxes[k]
        by_age = 1.0 if box.fading is None else box.fading.share(ways.hour)
        inside = (ways.position >= box.low) & (ways.position < box.high)
        return np.asarray(inside.all(axis=1) & (ways.rank < self._share[k] * by_age))

    def sample(self, k: int, passed: Tally, lattice: Lattice, min_vehicles: int) -> Sample:
        """Of the k-th box."""
        parts = [part.some(self._taken(part, k)) for part in self._parts]
        found = WayRows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        if min_vehicles > 1 and found.way.size:
            found = found.some(is_passed(found.visible().tracks, passed, lattice, min_vehicles))
        return Sample(found, float(self._share[k]))


def _rows_of(steps: Tally, lattice: Lattice, i: int, rows: str) -> WayRows:
    """Those of recording number `i`, known by the hash of its rows."""
    tracks, kind = pseudo_tracks(steps, lattice)
    hour, _, _ = unpacked_when(steps.key[kind, WHEN], lattice)
    way = tracks.track_id.astype(np.int64)
    begins = np.append(True, way[1:] != way[:-1])[: way.size]
    time_ns = tracks.time_ns - tracks.time_ns[begins][np.cumsum(begins) - 1]
    return WayRows(
        i * WAYS_EACH + way, time_ns, i * WAYS_EACH + np.arange(way.size), tracks.position, tracks.direction,
        tracks.speed, hour, rank_of(way, rows),
    )  # fmt: skip


def rank_of(way: IntArray, rows: str) -> FloatArray:
    """(n,) of ways of a recording, spread evenly from 0 to 1: of a share of them, those below it are taken. (n,)."""
    return np.asarray(((way + 1) * GOLDEN + int(rows[:8], 16) / (1 << 32)) % 1.0, np.float64)


class Pieces(NamedTuple):
    """Rows of ways within a box, as learning takes them, and when the segments that it fills in begin."""

    rows: TrackRows
    way: IntArray  # (n_segments,)
    begin_ns: IntArray  # (n_segments,) since the way began
    hour: IntArray  # (n_vehicles,) since 1970-01-01, in which the way of each began

    @classmethod
    def of(cls, inside: WayRows) -> Self:
        """Of rows in a box; nothing is filled in where a way leaves it."""
        breaks = np.append(True, (np.diff(inside.number) != 1) | (np.diff(inside.way) != 0))[: inside.way.size]
        _, row, vehicle = np.unique(inside.way, return_index=True, return_inverse=True)
        time_ns = inside.time_ns + np.cumsum(breaks) * APART_NS
        apart = (np.diff(vehicle) != 0) | (np.diff(time_ns) > LONGEST_GAP_NS)
        first = np.append(0, np.flatnonzero(apart) + 1)[: inside.way.size]
        rows = TrackRows(
            vehicle=vehicle, time_ns=time_ns, position=inside.position, direction=inside.direction,
            speed=inside.speed, group=vehicle,
        )  # fmt: skip
        return cls(rows, inside.way[first], inside.time_ns[first], inside.hour[row])
