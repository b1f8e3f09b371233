"""Where does a sensor not see? Where vehicles pass again and again and none is ever detected.

A visit of a vehicle to a cell of a grid is one vote. In sight misses follow each other, so a visit of n frames shows
nothing with probability m s^(n - 1), of the share m of misses and the share s of misses after a miss; out of sight a
detection is but taken for the vehicle's by mistake. A cell is blind if its visits are likelier so by a factor of 100
times the number of cells: a sensor that sees everywhere is called blind anywhere once in a hundred times at most
(Markov's inequality). Elsewhere the sensor sees, for all that is known.

Source: Gilbert, Capacity of a burst-noise channel, 1960, for the misses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.sight import MOST_VERTICES, Sight

CELL_M = (5.0, 10.0, 20.0, 40.0)
"""Sides of cells: the first by which the polygons are few enough."""
FALSE_ALARM = 0.01
MISTAKEN = 0.02
"""Probability that a visit out of sight shows a detection."""
LEAST_MISSED = 0.05
"""Of a visit in sight, however long: a lorry or a tree may hide a vehicle all the while."""
ROUNDS = 4
"""Of finding how misses follow each other, and where they are of the sensor's sight."""
REACH_CELLS = 2.0
"""So far beside a blind cell one in which too little passed is blind as well, if that is the nearest that is known."""
LONGEST_S = 5.0
"""After which it is not known how a vehicle went that was lost and found again."""
BEYOND_M = 100.0
"""So far beyond all that is known a sensor is said to see."""
MOST_RECTANGLES = MOST_VERTICES // 8


@dataclass(frozen=True, slots=True)
class Passages:
    """Vehicles in the frames of a sensor, detected or not. (n,) rows, vehicle after vehicle, ascending in time.

    Attributes:
        vehicle: (n,) numbers.
        position: (n, 2) metres.
        is_hit: (n,) whether it was detected.
    """

    vehicle: IntArray
    position: FloatArray
    is_hit: BoolArray

    def __getitem__(self, rows: AnyArray) -> Passages:
        """The chosen rows, by mask or indices."""
        return Passages(self.vehicle[rows], self.position[rows], self.is_hit[rows])


def between_detections(
    vehicle: IntArray, frame: IntArray, position: FloatArray, velocity: FloatArray, frame_s: FloatArray
) -> tuple[Passages, FloatArray]:
    """Of vehicles that were lost and found again under the same name, which shows that they were there.

    Args:
        vehicle: (n,) numbers of the detections' vehicles; a vehicle is detected once a frame.
        frame: (n,) indices.
        position: (n, 2) metres.
        velocity: (n, 2) m/s, NaN where it is not known; by both ends the way between is a cubic.
        frame_s: (f,) seconds of all frames.

    Returns:
        The passages (n + m,), up to gaps of `LONGEST_S`, and (n + m,) seconds between the detections before and after;
        0 for these.
    """
    order = np.lexsort((frame, vehicle))
    vehicle, frame = vehicle[order], frame[order]
    time_s, position, velocity = frame_s[frame], position[order], velocity[order]
    is_lost = (np.diff(vehicle) == 0) & (np.diff(time_s) <= LONGEST_S)
    missed = np.where(is_lost, np.diff(frame) - 1, 0)
    before = np.repeat(np.arange(missed.size), missed)
    after = before + 1
    number = np.arange(before.size) - np.repeat(np.cumsum(missed) - missed, missed) + 1
    gap_s = (time_s[after] - time_s[before])[:, None]
    chord = (position[after] - position[before]) / gap_s
    first, last = (np.where(np.isnan(velocity[end]), chord, velocity[end]) for end in (before, after))
    u = (frame_s[frame[before] + number] - time_s[before])[:, None] / gap_s
    way = (
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * position[before] + u**2 * (3.0 - 2.0 * u) * position[after]
        + gap_s * u * (1.0 - u) * ((1.0 - u) * first - u * last)
    )  # fmt: skip
    found = Passages(
        np.concatenate([vehicle, vehicle[before]]), np.concatenate([position, way]),
        np.arange(vehicle.size + before.size) < vehicle.size,
    )  # fmt: skip
    rows = np.lexsort((np.concatenate([frame, frame[before] + number]), found.vehicle))
    return found[rows], np.concatenate([np.zeros(vehicle.size), gap_s[:, 0]])[rows]


def learn_sight(passages: Passages) -> Sight | None:
    """The plane without what is blind, as rectangles; None where nothing is."""
    if passages.is_hit.all():
        return None
    for side_m in CELL_M:
        grid = _Grid.of(passages.position, side_m)
        known, blind = _judged(grid, passages)
        if not blind.any():
            return None
        sees = grid.everywhere(known, blind)
        if not sees.any():
            return None
        rectangles = _cover(sees)
        if len(rectangles) <= MOST_RECTANGLES:
            return Sight(tuple(map(grid.polygon, rectangles)))
    return None


def clearly_seen(sight: Sight | None, position: FloatArray) -> BoolArray:
    """(n, 2) -> (n,) whether positions are in sight and not at its edge, known to a cell; None sees everywhere."""
    if sight is None:
        return np.ones(len(position), np.bool_)
    about = CELL_M[0] * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    return np.asarray(sight.sees(position[:, None] + about).all(axis=1))


class Surveyed:
    """The part of a box in which the sensor sees, and near which vehicles passed where it does not see everywhere."""

    def __init__(self, sight: Sight | None, passed: FloatArray, low: FloatArray, high: FloatArray) -> None:
        self._sight, self._low, self._high = sight, low, np.maximum(high, low + 1.0)
        self._passed = None if sight is None else KDTree(passed)
        middles = (np.arange(100) + 0.5) / 100
        places = self._low + (self._high - self._low) * np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        share = max(float(self.contains(places).mean()), 1e-4)
        self.area = float(np.prod(self._high - self._low)) * share

    def contains(self, position: FloatArray) -> BoolArray:
        """(n, 2) -> (n,)."""
        inside = ((position >= self._low) & (position <= self._high)).all(axis=1) & clearly_seen(self._sight, position)
        if self._passed is not None:
            inside &= self._passed.query(position)[0] <= CELL_M[0]
        return np.asarray(inside)


class Rectangle(NamedTuple):
    """Of cells, ends included."""

    first: int
    last: int
    low: int
    high: int


class _Grid(NamedTuple):
    """Square cells over all positions, and a margin of those in which nothing passed."""

    low: FloatArray
    side_m: float
    shape: tuple[int, int]
    cell: IntArray  # (n,) of each row

    @classmethod
    def of(cls, position: FloatArray, side_m: float) -> _Grid:
        margin = int(REACH_CELLS) + 1
        low = np.floor(position.min(axis=0) / side_m) - margin
        place = np.floor(position / side_m - low).astype(np.int64)
        shape = place.max(axis=0) + 1 + margin
        return cls(low * side_m, side_m, (int(shape[0]), int(shape[1])), place[:, 0] * shape[1] + place[:, 1])

    def everywhere(self, known: IntArray, blind: BoolArray) -> BoolArray:
        """Of all cells whether the sensor sees there, by which of the `known` cells (k,) are blind (k,)."""
        places = np.column_stack(np.unravel_index(known, self.shape))
        all_places = np.indices(self.shape).reshape(2, -1).T
        distance, nearest = KDTree(places).query(all_places)
        return np.asarray(~(blind[nearest] & (distance <= REACH_CELLS))).reshape(self.shape)

    def polygon(self, of: Rectangle) -> tuple[tuple[float, float], ...]:
        """Its corners, metres; at the grid's edge it goes on beyond."""
        ends = np.array([[of.first, of.last + 1], [of.low, of.high + 1]])
        metres = self.low[:, None] + self.side_m * ends
        beyond = BEYOND_M * (ends == np.array([[0, n] for n in self.shape])) * [-1.0, 1.0]
        (x0, x1), (y0, y1) = (metres + beyond).tolist()
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def _judged(grid: _Grid, passages: Passages) -> tuple[IntArray, BoolArray]:
    """The cells (k,) of which something is known, and which of them are blind (k,)."""
    cells, of_row = np.unique(grid.cell, return_inverse=True)
    n = cells.size
    follows = (np.diff(passages.vehicle, prepend=-1) == 0) & (np.diff(of_row, prepend=-1) == 0)
    visit = np.cumsum(~follows) - 1
    first = np.flatnonzero(~follows)
    n_frames, shows = np.bincount(visit), np.bincount(visit, weights=passages.is_hit) > 0
    cell = of_row[first]
    n_shown = np.bincount(cell, weights=shows, minlength=n)
    blind: BoolArray = np.asarray(n_shown == 0)
    for _ in range(ROUNDS):
        missed = _missed(~blind[of_row], follows, passages.is_hit, n_frames)
        of_visit = np.where(shows, np.log(MISTAKEN / (1.0 - missed)), np.log((1.0 - MISTAKEN) / missed))
        found: BoolArray = np.asarray(np.bincount(cell, weights=of_visit, minlength=n) > np.log(n / FALSE_ALARM))
        if np.array_equal(found, blind):
            break
        blind = found
    known = blind | (n_shown > 0)
    return cells[known], blind[known]


def _missed(in_sight: BoolArray, follows: BoolArray, is_hit: BoolArray, n_frames: IntArray) -> FloatArray:
    """(v,) probability that a visit of so many frames (v,) shows nothing in sight, by the rows (n,) that are in it."""
    share = (np.sum(in_sight & ~is_hit) + 0.5) / (np.sum(in_sight) + 1.0)
    after = in_sight & follows & ~np.concatenate([[True], is_hit[:-1]])
    again = (np.sum(after & ~is_hit) + 0.5) / (np.sum(after) + 1.0)
    return np.asarray(np.maximum(share * again ** (n_frames - 1.0), LEAST_MISSED))


def _cover(sees: BoolArray) -> list[Rectangle]:
    """Rectangles of cells that cover what is in sight and nothing else; they overlap, each as large as it may be."""
    left = sees.copy()
    found = []
    while left.any():
        i, j = divmod(int(np.argmax(left)), left.shape[1])
        wide = _grown(sees, i, j)
        low, high, first, last = _grown(sees.T, j, i)
        tall = Rectangle(first, last, low, high)
        found.append(max(wide, tall, key=lambda r: (r.last - r.first + 1) * (r.high - r.low + 1)))
        left[found[-1].first : found[-1].last + 1, found[-1].low : found[-1].high + 1] = False
    return found


def _grown(sees: BoolArray, i: int, j: int) -> Rectangle:
    """About a cell in sight, first along its row and then across it."""
    low, high = _run(sees[i, :], j)
    first, last = _run(np.asarray(sees[:, low : high + 1].all(axis=1)), i)
    return Rectangle(first, last, low, high)


def _run(row: BoolArray, at: int) -> tuple[int, int]:
    """First and last of those about `at` that are all true."""
    ends = np.concatenate([[-1], np.flatnonzero(~row), [row.size]])
    k = int(np.searchsorted(ends, at))
    return int(ends[k - 1]) + 1, int(ends[k]) - 1
