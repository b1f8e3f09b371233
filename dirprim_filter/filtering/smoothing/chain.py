"""The recorded states of one belief, so that later measurements can correct earlier estimates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import N_STATES

LOWER = np.tril_indices(N_STATES)
LINK = np.dtype(
    [
        ("time_ns", "<i8"),
        ("mean", "<f8", (N_STATES,)),
        ("later", "<f8", (N_STATES,)),
        ("gain", "<f4", (N_STATES, N_STATES)),
        ("spread", "<f4", (LOWER[0].size,)),
        ("course", "<f4", (2,)),
        ("ahead", "<i2"),
        ("is_measured", "?"),
    ]
)
"""187 bytes: how a state of a vehicle followed from a later one, see `_kernels`.

`spread` is the lower triangle; `course` is the mean of cosine and sine of the direction; `ahead` counts the links to
the later state's; `is_measured` says whether the vehicle was measured at that time.
"""
FIRST_CAPACITY = 64


class Belief(NamedTuple):
    """A belief about one vehicle at one time.

    Attributes:
        time_ns: nanoseconds.
        mean: (4,) x, y and their rates.
        covariance: (4, 4).
        course: (2,) mean of cosine and sine of the direction.
    """

    time_ns: int
    mean: FloatArray
    covariance: FloatArray
    course: FloatArray


class Smoothed(NamedTuple):
    """Beliefs about one vehicle, each given all measurements of its chain.

    Attributes:
        time_ns: (n,) ascending.
        mean: (n, 4).
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

    Attributes:
        name: of the vehicle; empty until it is reported.
        existence: the largest reported probability that the track is a vehicle.
        first_ns: time of the first measurement.
        last: what the filter believed at the last measurement.
        until_ns: from this time on another chain has the slot; None while none does.
    """

    def __init__(self, first: Belief) -> None:
        self.name = ""
        self.existence = 0.0
        self.last = first
        self.first_ns = first.time_ns
        self.until_ns: int | None = None
        self._links: AnyArray = np.empty(FIRST_CAPACITY, LINK)
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def extend(self, links: AnyArray, last: Belief) -> None:
        """Add the links (m,) of the way to a new last measurement."""
        end = self._n + links.size
        if end > self._links.size:
            self._links = np.concatenate([self._links[: self._n], np.empty(end, LINK)])
        self._links[self._n : end] = links
        self._n, self.last = end, last

    def smoothed(self) -> Smoothed:
        """All beliefs that are kept, given all measurements so far."""
        n, links = self._n, self._links[: self._n]
        mean, covariance = np.empty((n + 1, N_STATES)), np.empty((n + 1, N_STATES, N_STATES))
        mean[n], covariance[n] = self.last.mean, self.last.covariance
        _kernels.sweep_back(
            links["ahead"].astype(np.int64), np.ascontiguousarray(links["mean"]), np.ascontiguousarray(links["later"]),
            links["gain"].astype(np.float64), _full(links["spread"]), mean, covariance,
        )  # fmt: skip
        time_ns = np.append(links["time_ns"], self.last.time_ns)
        is_measured = np.append(links["is_measured"], True)
        return Smoothed(
            time_ns, mean, covariance, np.concatenate([links["course"], self.last.course[None]]).astype(np.float64),
            np.maximum.accumulate(np.where(is_measured, time_ns, np.iinfo(np.int64).min)),
        )  # fmt: skip

    def forget(self, *, before_ns: int) -> None:
        """Drop what is only needed for beliefs at earlier times than this."""
        time_ns = self._links["time_ns"][: self._n]
        kept = max(int(np.searchsorted(time_ns, before_ns, side="right")) - 1, 0)
        if kept:
            self._links = np.concatenate([self._links[kept : self._n], np.empty(FIRST_CAPACITY, LINK)])
            self._n -= kept


def _full(lower: AnyArray) -> FloatArray:
    """(n, 10) lower triangles -> (n, 4, 4)."""
    full = np.empty((len(lower), N_STATES, N_STATES))
    full[:, LOWER[0], LOWER[1]] = full[:, LOWER[1], LOWER[0]] = lower
    return full
