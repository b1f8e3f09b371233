"""The observations that primitives are learned from: thinned, and sorted by cell."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray, read_only
from dirprim_filter.primitives import _thinning
from dirprim_filter.primitives._modes import COSINE, EAST, LOG_SPEED, N_OF_ROW, NORTH, SINE, SPEED, WEIGHT
from dirprim_filter.tracks import Tracks
from tessellation.protocols import Members

MIN_GROUPS = 3
"""What is held out for choosing is a third at a time: of fewer groups it would be more."""
MAX_GROUP_SHARE = 0.5
"""Of the rows: without a larger group there is not enough left to learn from."""


class Scale(NamedTuple):
    """One length and one time of the data, from which metres and seconds of learning follow.

    Cars at 2 Hz and more, pedestrians and bicycles have the least of both; GPS of buses every 3 s and ships every 10 s
    have more. Up to 600 m and 20 s between rows vehicles are followed.
    """

    reach_m: float = 3.0  # half of what vehicles drive between two rows; at least a lane's width
    interval_s: float = 0.2  # between two rows of a vehicle

    @classmethod
    def of(cls, vehicle: IntArray, time_ns: IntArray, position: FloatArray) -> Scale:
        """Medians, of rows sorted by vehicle and time."""
        same = np.diff(vehicle) == 0
        interval_s = np.diff(time_ns)[same] * 1e-9
        way = np.hypot(*np.diff(position, axis=0)[same].T)
        driven = way[way > 0.3 * interval_s]  # who is slower stands
        reach, interval = (float(np.median(of)) if of.size else 0.0 for of in (0.5 * driven, interval_s))
        return cls(float(np.clip(reach, 3.0, 300.0)), float(np.clip(interval, 0.2, 20.0)))

    @property
    def length(self) -> float:
        """Lengths of learning over those of vehicles that are seen often."""
        return self.reach_m / 3.0

    @property
    def step_s(self) -> float:
        """Between instants of a vehicle that is filled in: about a tenth of the interval."""
        return 0.1 * max(round(self.interval_s), 1)

    @property
    def longest_gap_s(self) -> float:
        """Between two rows that are further apart it is not known where a vehicle went."""
        return max(3.0 * self.interval_s, 1.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRows:
    """Rows of tracks after thinning, sorted by vehicle and time.

    Attributes:
        vehicle: (n,) 0 to n_vehicles - 1.
        time_ns: (n,) int64.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        group: (n,) int64, what to split by: the log's groups or, where they are few or one rules, the vehicles.
        weight: (n,) positive, how many vehicles a row's vehicle stands for.
        scale: of all the rows that these are of.
    """

    vehicle: IntArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray
    weight: FloatArray
    scale: Scale

    @classmethod
    def thinned(cls, tracks: Tracks, *, interval_s: float, weight: FloatArray | None = None) -> TrackRows:
        """The rows of each vehicle that are about `interval_s` apart or more: 10 Hz rows repeat each other.

        Args:
            tracks: of vehicles.
            interval_s: seconds.
            weight: (n_tracks,) of each vehicle; one each if absent.
        """
        vehicle = tracks.vehicle
        order = np.argsort(vehicle, kind="stable")  # tracks are in order of time
        keep = np.empty(order.size, np.bool_)
        _thinning.thin(order, vehicle, read_only(tracks.time_ns), int(interval_s * 1e9), keep)
        kept = order[keep]
        _, n_rows = np.unique(tracks.group[kept], return_counts=True)
        grouped = n_rows.size >= MIN_GROUPS and n_rows.max() <= MAX_GROUP_SHARE * kept.size
        return cls(
            vehicle=vehicle[kept],
            time_ns=tracks.time_ns[kept],
            position=tracks.position[kept],
            direction=tracks.direction[kept],
            speed=tracks.speed[kept],
            group=(tracks.group if grouped else vehicle)[kept],
            weight=np.ones(kept.size) if weight is None else weight[vehicle[kept]],
            scale=Scale.of(vehicle[kept], tracks.time_ns[kept], tracks.position[kept]),
        )

    def __len__(self) -> int:
        return int(self.vehicle.size)

    def __getitem__(self, rows: BoolArray | IntArray) -> TrackRows:
        """The chosen rows, by mask or indices."""
        columns = (f.name for f in fields(self) if f.name != "scale")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})

    def some(self, most_rows: int, *, rng: np.random.Generator) -> TrackRows:
        """All rows, or those of vehicles drawn at random, of about so many rows together.

        Of vehicles with more rows than that every second, third, ... row: never none.
        """
        if len(self) <= most_rows:
            return self
        n_rows = np.bincount(self.vehicle)
        order = rng.permutation(n_rows.size)
        before = np.cumsum(n_rows[order]) - n_rows[order]
        chosen = self[np.isin(self.vehicle, order[before < most_rows])]
        stride = len(chosen) // most_rows
        return chosen[np.arange(0, len(chosen), stride)] if stride > 1 else chosen

    @property
    def n_vehicles(self) -> int:
        """Number of vehicles that have a row."""
        return int(np.unique(self.vehicle).size)


class CellRows(NamedTuple):
    """What cells are fitted to: the rows of each that move, cell by cell, and how much there is of them."""

    columns: FloatArray  # (N_OF_ROW, n) see `_modes`; metres from the centre of the cell
    start: IntArray  # (n_cells + 1,) cell c has the columns from start[c] to start[c + 1]
    n_vehicles: FloatArray  # (n_cells,) that these rows are of
    n_moving: FloatArray  # (n_cells,) rows, by weight
    n_standing: FloatArray  # (n_cells,) slower rows, by weight, which are left out

    @classmethod
    def of(cls, rows: TrackRows, members: Members, position: FloatArray, *, standing_speed: float) -> CellRows:
        """The members of cells; positions (n, 2) of the rows are from the same origin as the members' centres.

        A cell's vehicles count as many as they say as much as (Kish 1965): those that weigh alike one each.
        """
        n_cells, weight = len(members.center), rows.weight[members.row]
        cell = np.repeat(np.arange(n_cells), np.diff(members.start))
        total, square = (np.bincount(cell, column, minlength=n_cells) for column in (weight, weight**2))
        weight = members.weight * weight * (total / np.where(square > 0.0, square, 1.0))[cell]
        moves = rows.speed[members.row] >= standing_speed
        n_moving, n_standing = (np.bincount(cell[of], weight[of], minlength=n_cells) for of in (moves, ~moves))
        cell, row, weight = cell[moves], members.row[moves], weight[moves]
        start = np.append(0, np.cumsum(moves))[members.start]
        used, index = (slice(None), row) if row.size > len(rows) else (row, slice(None))  # what costs less
        direction, speed = rows.direction[used], np.maximum(rows.speed[used], 1e-300)
        columns = np.empty((N_OF_ROW, row.size))
        columns[COSINE], columns[SINE] = np.cos(direction)[index], np.sin(direction)[index]
        columns[SPEED], columns[LOG_SPEED], columns[WEIGHT] = speed[index], np.log(speed)[index], weight
        columns[EAST], columns[NORTH] = (position[row] - members.center[cell]).T
        n_vehicles = _count_vehicles(cell, rows.vehicle[row], weight, n_cells)
        return cls(columns, start, n_vehicles, *(np.asarray(of, np.float64) for of in (n_moving, n_standing)))


def _count_vehicles(cell: IntArray, vehicle: IntArray, weight: FloatArray, n_cells: int) -> FloatArray:
    """How many vehicles each cell's members are of, where those of a cell, and of a vehicle in it, stand together.

    A vehicle counts as much as the weightiest of its rows: one that only passes by is less than one.
    """
    if not cell.size:
        return np.zeros(n_cells)
    begins = np.flatnonzero(np.append(True, (np.diff(cell) != 0) | (np.diff(vehicle) != 0)))
    return np.asarray(np.bincount(cell[begins], np.maximum.reduceat(weight, begins), n_cells), np.float64)
