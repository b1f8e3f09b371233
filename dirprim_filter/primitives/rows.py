"""The observations that primitives are learned from: thinned, and sorted by cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.primitives import _kernels
from dirprim_filter.tracks import Tracks
from tessellation import Tessellation
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray

MIN_GROUPS = 6
"""Of fewer groups, holding one out leaves out too much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRows:
    """Rows of tracks that tell something new, sorted by vehicle and time.

    Attributes:
        vehicle: (n,) 0 to n_vehicles - 1.
        time_ns: (n,) int64.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        group: (n,) int64, what to split by: the log's groups or, where they are few, the vehicles.
    """

    vehicle: IntArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray

    @classmethod
    def thinned(cls, tracks: Tracks, *, interval_s: float) -> TrackRows:
        """The rows of each vehicle that are at least `interval_s` apart: 10 Hz rows repeat each other."""
        _, vehicle = np.unique(tracks.track_id, return_inverse=True)
        order = np.lexsort((tracks.time_ns, vehicle))
        kept = order[_kernels.thin(vehicle[order], tracks.time_ns[order], int(interval_s * 1e9))]
        grouped = np.unique(tracks.group).size >= MIN_GROUPS
        return cls(
            vehicle=vehicle[kept],
            time_ns=tracks.time_ns[kept],
            position=tracks.position[kept],
            direction=tracks.direction[kept],
            speed=tracks.speed[kept],
            group=(tracks.group if grouped else vehicle)[kept],
        )

    def __len__(self) -> int:
        return int(self.vehicle.size)

    def __getitem__(self, rows: BoolArray | IntArray) -> TrackRows:
        """The chosen rows, by mask or indices."""
        return TrackRows(
            vehicle=self.vehicle[rows],
            time_ns=self.time_ns[rows],
            position=self.position[rows],
            direction=self.direction[rows],
            speed=self.speed[rows],
            group=self.group[rows],
        )

    @property
    def n_vehicles(self) -> int:
        """Number of vehicles that have a row."""
        return int(np.unique(self.vehicle).size)


@dataclass(frozen=True, slots=True, kw_only=True)
class CellRows:
    """Moving rows sorted by cell and direction, and what each cell holds.

    Attributes:
        rows: the columns of moving rows, as the kernels take them.
        start: (n_cells + 1,) cell c has rows start[c] to start[c + 1].
        n_vehicles: (n_cells,) vehicles with a moving row in the cell.
        n_standing: (n_cells,) rows of standing vehicles.
    """

    rows: _kernels.Rows
    start: IntArray
    n_vehicles: FloatArray
    n_standing: IntArray

    @classmethod
    def of(cls, rows: TrackRows, tessellation: Tessellation, *, standing_speed: float) -> CellRows:
        """Sort rows into the cells; rows outside of every cell are left to the place-free primitive."""
        cell = tessellation.cell_of(rows.position)
        standing = rows.speed < standing_speed
        n_cells = tessellation.n_cells
        moving = np.flatnonzero(~standing & (cell >= 0))
        order = moving[np.lexsort((rows.direction[moving], cell[moving]))]
        return cls(
            rows=columns_of(
                rows.direction[order], rows.speed[order], rows.position[order] - tessellation.centers[cell[order]]
            ),
            start=np.searchsorted(cell[order], np.arange(n_cells + 1)).astype(np.int64),
            n_vehicles=_vehicles_per_cell(cell[order], rows.vehicle[order], n_cells),
            n_standing=np.bincount(cell[standing & (cell >= 0)], minlength=n_cells).astype(np.int64),
        )

    @property
    def n_rows(self) -> IntArray:
        """(n_cells,) rows of moving and standing vehicles."""
        return np.asarray(np.diff(self.start) + self.n_standing, dtype=np.int64)


def columns_of(direction: FloatArray, speed: FloatArray, offset: FloatArray) -> _kernels.Rows:
    """The columns of moving rows, as the kernels take them.

    Args:
        direction: (n,) radians, ascending inside a cell.
        speed: (n,) m/s, positive.
        offset: (n, 2) metres from the centre of the cell.
    """
    return _kernels.Rows(
        direction,
        np.cos(direction),
        np.sin(direction),
        speed,
        np.log(speed),
        np.ones_like(speed),
        np.ascontiguousarray(offset[:, 0]),
        np.ascontiguousarray(offset[:, 1]),
    )


def _vehicles_per_cell(cell: IntArray, vehicle: AnyArray, n_cells: int) -> FloatArray:
    pairs = np.unique(np.stack([cell, vehicle]), axis=1)
    return np.bincount(pairs[0], minlength=n_cells).astype(np.float64)
