"""The recorded states of one belief, so that later measurements can correct earlier estimates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.filtering.smoothing import _kernels

FIRST_CAPACITY = 64
MOVES = 4
"""Of a state: place and velocity, which estimates tell."""
SAME_VEHICLE = 36.0
"""Squared Mahalanobis distance up to which one belief may be the continuation of another."""


def link_type(n_states: int, *, gain: str) -> np.dtype[np.void]:
    """How a state of a vehicle followed from a later one, see `_kernels`; at most 200 bytes.

    `step` leads from the mean to the later one; `spread` is a lower triangle; `course` is the mean of cosine and sine
    of the direction; `ahead` counts the links to the later state's; `is_measured` tells whether the vehicle was
    measured at that time.
    """
    return np.dtype([
        ("time_ns", "<i8"), ("mean", "<f8", (n_states,)), ("step", "<f4", (n_states,)),
        ("gain", gain, (n_states, n_states)), ("spread", "<f4", (n_states * (n_states + 1) // 2,)),
        ("course", "<f4", (2,)), ("ahead", "<i2"), ("is_measured", "?"),
    ])  # fmt: skip


def lower(n_states: int) -> tuple[IntArray, IntArray]:
    """Rows and columns of a lower triangle."""
    return np.tril_indices(n_states)


class Belief(NamedTuple):
    """A belief about one vehicle at one time.

    Attributes:
        time_ns: nanoseconds.
        mean: (d,) x, y, their rates, and whatever else lasts.
        covariance: (d, d).
        course: (2,) mean of cosine and sine of the direction.
    """

    time_ns: int
    mean: FloatArray
    covariance: FloatArray
    course: FloatArray

    def may_be(self, other: Belief) -> bool:
        """Whether the places of two beliefs of one time are near enough for one vehicle."""
        off = other.mean[:2] - self.mean[:2]
        spread = self.covariance[:2, :2] + other.covariance[:2, :2] + 1e-12 * np.eye(2)
        return bool(off @ np.linalg.solve(spread, off) <= SAME_VEHICLE)


class Smoothed(NamedTuple):
    """Beliefs about one vehicle, each given all measurements of its chain.

    Attributes:
        time_ns: (n,) ascending.
        mean: (n, 4) x, y and their rates.
        covariance: (n, 4, 4).
        course: (n, 2) as the filter knew it, for vehicles that stand.
        measured_ns: (n,) time of the last measurement by then.
    """

    time_ns: IntArray
    mean: FloatArray
    covariance: FloatArray
    course: FloatArray
    measured_ns: IntArray

    def at(self, time_ns: IntArray) -> Smoothed:
        """The same at times between the first and the last, linear between neighbours: a step of the filter apart."""
        after = np.minimum(np.searchsorted(self.time_ns, time_ns), self.time_ns.size - 1)
        before = np.maximum(after - 1, 0)
        span = np.maximum(self.time_ns[after] - self.time_ns[before], 1)
        share = 1.0 - (self.time_ns[after] - time_ns) / span

        def between(column: FloatArray) -> FloatArray:
            part = share.reshape(-1, *[1] * (column.ndim - 1))
            return np.asarray((1.0 - part) * column[before] + part * column[after])

        reached = np.where(time_ns >= self.time_ns[after], after, before)
        return Smoothed(
            np.asarray(time_ns, np.int64), between(self.mean), between(self.covariance), between(self.course),
            self.measured_ns[reached],
        )  # fmt: skip


class Chain:
    """The links of one belief from its birth to its last measurement.

    Args:
        first: at birth.
        kind: of its links, a `link_type`.

    Attributes:
        name: of the vehicle; empty until it is reported.
        existence: the largest reported probability that the track is a vehicle.
        first_ns: time of the first measurement.
        last: what the filter believed at the last measurement.
        until_ns: from this time on another chain has the slot; None while none does.
    """

    def __init__(self, first: Belief, kind: np.dtype[np.void]) -> None:
        self.name = ""
        self.existence = 0.0
        self.last = first
        self.first_ns = first.time_ns
        self.until_ns: int | None = None
        self._links: AnyArray = np.empty(FIRST_CAPACITY, kind)
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def extend(self, links: AnyArray, last: Belief) -> None:
        """Add the links (m,) of the way to a new last measurement."""
        end = self._n + links.size
        if end > self._links.size:
            self._links = np.concatenate([self._links[: self._n], np.empty(end, links.dtype)])
        self._links[self._n : end] = links
        self._n, self.last = end, last

    def smoothed(self) -> Smoothed:
        """All beliefs that are kept, given all measurements so far."""
        n, links, d = self._n, self._links[: self._n], self.last.mean.size
        mean, covariance = np.empty((n + 1, d)), np.empty((n + 1, d, d))
        mean[n], covariance[n] = self.last.mean, self.last.covariance
        of = np.ascontiguousarray(links["mean"])
        _kernels.sweep_back(
            links["ahead"].astype(np.int64), of, of + links["step"], links["gain"].astype(np.float64),
            _full(links["spread"], d), mean, covariance,
        )  # fmt: skip
        time_ns = np.append(links["time_ns"], self.last.time_ns)
        is_measured = np.append(links["is_measured"], True)
        course = np.concatenate([links["course"], self.last.course[None]]).astype(np.float64)
        measured_ns = np.maximum.accumulate(np.where(is_measured, time_ns, np.iinfo(np.int64).min))
        return Smoothed(time_ns, mean[:, :MOVES], covariance[:, :MOVES, :MOVES], course, measured_ns)

    def forget(self, *, before_ns: int) -> None:
        """Drop what is only needed for beliefs at earlier times than this."""
        time_ns = self._links["time_ns"][: self._n]
        kept = max(int(np.searchsorted(time_ns, before_ns, side="right")) - 1, 0)
        if kept:
            self._links = np.concatenate([self._links[kept : self._n], np.empty(FIRST_CAPACITY, self._links.dtype)])
            self._n -= kept


def _full(triangle: AnyArray, d: int) -> FloatArray:
    """(n, d (d + 1) / 2) lower triangles -> (n, d, d)."""
    row, column = lower(d)
    full = np.empty((len(triangle), d, d))
    full[:, row, column] = full[:, column, row] = triangle
    return full
