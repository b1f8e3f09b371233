"""Vehicles and estimates of them, instant by instant: which are near each other?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.evaluation.tracked_rows import TrackedRows, instant_numbers
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

SIMILARITY_M = 5.0
"""Metres: similarity is max(0, 1 - distance / SIMILARITY_M), and GOSPA's cut-off. Of cars; others say theirs."""

EPSILON = float(np.finfo(np.float64).eps)
"""By which a similarity may be below a threshold that it reaches."""


class Pairs(NamedTuple):
    """Rows of the truth and rows of the estimates of the same instant.

    Attributes:
        row: (p,) of the truth.
        column: (p,) of the estimates.
        distance: (p,) metres.
    """

    row: IntArray
    column: IntArray
    distance: FloatArray

    def chosen(self, which: npt.NDArray[np.generic]) -> Pairs:
        """Some of the pairs, by mask or indices."""
        return Pairs(*(values[which] for values in self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Vehicles and tracks of one scene or of several; nothing of one scene is near anything of another.

    Attributes:
        vehicle: (n,) int64, the number of each true row's vehicle, from 0.
        track: (m,) int64, the number of each estimate's track, from 0.
        row_instant: (n,) int64, the number of each true row's instant; instants of a scene are in order of time.
        column_instant: (m,) int64, the same of each estimate.
        near: the pairs that are less than `similarity_m` apart, by instant.
        similarity_m: metres, from which on an estimate is not of a vehicle.
    """

    vehicle: IntArray
    track: IntArray
    row_instant: IntArray
    column_instant: IntArray
    near: Pairs
    similarity_m: float

    @classmethod
    def of(cls, truth: Tracks, rows: TrackedRows, *, similarity_m: float = SIMILARITY_M) -> Comparison:
        """Compare estimates with a truth, in which each group is a scene of its own.

        Args:
            truth: where vehicles were.
            rows: where a tracker says they were.
            similarity_m: metres, the one length of all metrics.

        Raises:
            ValueError: it is not positive.
        """
        if not similarity_m > 0:
            raise ValueError(f"similarity_m: expected a positive distance in metres, got {similarity_m}")
        row_instant, column_instant = instant_numbers(truth, rows)
        return cls(
            vehicle=truth.vehicle, track=vehicle_numbers(rows.track_id, rows.group), row_instant=row_instant,
            column_instant=column_instant,
            similarity_m=similarity_m,
            near=_near(truth.position, row_instant, rows.position, column_instant, similarity_m),
        )  # fmt: skip

    @property
    def n_vehicles(self) -> int:
        """How many vehicles there are."""
        return int(self.vehicle.max(initial=-1)) + 1

    @property
    def similarity(self) -> FloatArray:
        """(p,) of the near pairs, 1 - distance / similarity_m: 1 at the same place, 0 of all others."""
        return np.asarray(1.0 - self.near.distance / self.similarity_m)

    def companions(self, pairs: Pairs) -> tuple[IntArray, IntArray, IntArray]:
        """(c,), (c,) numbers of vehicles and their tracks in pairs of rows (p,), and (p,) which of them each is of."""
        n_tracks = int(self.track.max(initial=0)) + 1
        both, of_pair = np.unique(self.vehicle[pairs.row] * n_tracks + self.track[pairs.column], return_inverse=True)
        return both // n_tracks, both % n_tracks, of_pair.astype(np.int64)


def _near(a: FloatArray, a_instant: IntArray, b: FloatArray, b_instant: IntArray, reach_m: float) -> Pairs:
    """The pairs nearer than the reach: neighbours in the plane and, along a third axis, of the same instant."""
    if not (a_instant.size and b_instant.size):
        nothing = np.empty(0, np.int64)
        return Pairs(nothing, nothing, np.empty(0))
    apart = 4.0 * reach_m
    trees = [cKDTree(np.column_stack([place, apart * instant])) for place, instant in ((a, a_instant), (b, b_instant))]
    found = trees[0].sparse_distance_matrix(trees[1], reach_m * (1.0 + 1e-9), output_type="ndarray")
    row, column = found["i"].astype(np.int64), found["j"].astype(np.int64)
    order = np.lexsort((column, row, a_instant[row]))
    row, column = row[order], column[order]
    distance = np.sqrt(((a[row] - b[column]) ** 2).sum(axis=1))
    return Pairs(row, column, distance).chosen(distance < reach_m)
