"""The recorded states of one belief, so that later measurements can correct earlier estimates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import N_STATES

FIRST_CAPACITY = 64
REST_NS = 350_000_000
"""A pause: a vehicle in sight is seldom missed for so long."""
MOVES = 4
"""Of a state: place and velocity, which estimates have."""
SAME_VEHICLE = 36.0
"""Squared Mahalanobis distance up to which one belief may be the continuation of another."""
HARDEST = 8.0
"""m/s^2: no vehicle turns or brakes harder on average."""
SLACK_M = 5.0
"""Metres, beyond that."""
USUAL = 9.21
"""Squared Mahalanobis distance that one place in a hundred exceeds."""
LINK = np.dtype([
    ("time_ns", "<i8"), ("mean", "<f8", (N_STATES,)), ("step", "<f4", (N_STATES,)),
    ("gain", "<f4", (N_STATES, N_STATES)), ("spread", "<f4", (N_STATES, N_STATES)),
    ("course", "<f4", (2,)), ("ahead", "<i2"), ("is_measured", "?"),
])  # fmt: skip
"""How a state of a vehicle followed from a later one, see `_kernels`.

`step` leads from the mean to the later one; `course` is the mean of cosine and sine of the direction; `ahead` counts
the links to the later state's; `is_measured` says whether the vehicle was measured at that time.
"""


def may_be_off(dt_s: npt.ArrayLike) -> FloatArray:
    """Metres, how far from where it would be at an even velocity a vehicle may be after so many seconds."""
    return np.asarray(SLACK_M + 0.5 * HARDEST * np.square(dt_s))


class Belief(NamedTuple):
    """A belief about one vehicle at one time."""

    time_ns: int
    mean: FloatArray  # (d,) x, y, their rates, and whatever else lasts
    covariance: FloatArray  # (d, d)
    course: FloatArray  # (2,) mean of cosine and sine of the direction

    def squared_distance(self, other: Belief) -> float:
        """Squared Mahalanobis distance of the places of two beliefs of one time."""
        off = other.mean[:2] - self.mean[:2]
        spread = self.covariance[:2, :2] + other.covariance[:2, :2] + 1e-12 * np.eye(2)
        return float(off @ np.linalg.solve(spread, off))


class Smoothed(NamedTuple):
    """Beliefs about one vehicle, each given all measurements of its chain."""

    time_ns: IntArray  # (n,) ascending
    mean: FloatArray  # (n, 4) x, y and their rates
    covariance: FloatArray  # (n, 4, 4)
    course: FloatArray  # (n, 2) as the filter knew it, for vehicles that stand
    measured_ns: IntArray  # (n,) time of the last measurement by then

    def first(self) -> Belief:
        """The earliest of them."""
        return Belief(int(self.time_ns[0]), self.mean[0], self.covariance[0], self.course[0])

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

    Attributes:
        name: of the vehicle; empty until it is reported.
        is_labelled: whether the sensor named it.
        n_pieces: of how many it was joined.
        existence: the largest reported probability that the track is a vehicle.
        first_ns: time of the first measurement.
        last: the filter's belief at the last measurement.
        until_ns: from this time on another chain has the slot; None while none does.
    """

    def __init__(self, first: Belief) -> None:
        self.name = ""
        self.is_labelled = False
        self.n_pieces = 1
        self.existence = 0.0
        self.last = first
        self.first_ns = first.time_ns
        self.until_ns: int | None = None
        self._links: AnyArray = np.empty(FIRST_CAPACITY, LINK)
        self._n = 0
        self._rests: list[tuple[int, Belief]] = []  # how many links led to a belief that was then not measured for long

    def is_over(self, now_ns: int, gap_ns: int) -> bool:
        """Whether its vehicle, of which all is known up to a time, will not be measured again as this one."""
        return self.until_ns is not None or now_ns - self.last.time_ns > gap_ns

    def extend(self, links: AnyArray, last: Belief) -> None:
        """Add the links (m,) of the way to a new last measurement."""
        if last.time_ns - self.last.time_ns > REST_NS:
            self._rests.append((self._n, self.last))
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
            links["spread"].astype(np.float64), mean, covariance,
        )  # fmt: skip
        time_ns = np.append(links["time_ns"], self.last.time_ns)
        is_measured = np.append(links["is_measured"], True)
        course = np.concatenate([links["course"], self.last.course[None]]).astype(np.float64)
        measured_ns = np.maximum.accumulate(np.where(is_measured, time_ns, np.iinfo(np.int64).min))
        return Smoothed(time_ns, mean[:, :MOVES], covariance[:, :MOVES, :MOVES], course, measured_ns)

    def may_be_at(self, place: Belief) -> bool:
        """Whether the vehicle of the last belief may be where another belief of that time has it.

        A vehicle that the filter lost from sight may also be as far as the hardest braking or turning takes it.
        """
        if self.last.squared_distance(place) <= SAME_VEHICLE:
            return True
        if not self._rests:
            return False
        seen = self._rests[-1][1]
        dt_s = (place.time_ns - seen.time_ns) * 1e-9
        off = place.mean[:2] - seen.mean[:2] - dt_s * seen.mean[2:MOVES]
        return bool(np.hypot(*off) <= may_be_off(dt_s))

    def correct(self, last: Belief) -> None:
        """Put another belief in place of the last, which was perhaps too sure.

        Were all covariances since the last long pause larger by a factor, gains would be the same, and spreads larger
        by it: by as much as makes the distance of the two beliefs a usual one.
        """
        since = self._rests[-1][0] if self._rests else max(self._n - 1, 0)
        self._links["spread"][since : self._n] *= max(self.last.squared_distance(last) / USUAL, 1.0)
        self.last = last

    def take_up(self, former: Chain, between: AnyArray) -> None:
        """Be the continuation of another chain, by links (m,) from its end to the beginning of this one."""
        self._links = np.concatenate([former._links[: former._n], between, self._links[: self._n]])
        self._rests = [(n + self._links.size - self._n, belief) for n, belief in self._rests]
        self._n = self._links.size
        self.name, self.existence = former.name, max(former.existence, self.existence)
        self.first_ns, self.n_pieces = former.first_ns, former.n_pieces + self.n_pieces

    def tail(self) -> IntArray:
        """Times of the measurements since the last long pause, the latest first; none without such a pause."""
        if not self._rests:
            return np.empty(0, np.int64)
        links = self._links[self._rests[-1][0] : self._n]
        measured_ns = links["time_ns"][links["is_measured"]][1:]  # the first is from before the pause
        return np.append(measured_ns, self.last.time_ns)[::-1]

    def cut(self) -> None:
        """End at the measurement before the last long pause."""
        self._n, self.last = self._rests.pop()

    def forget(self, *, before_ns: int) -> None:
        """Drop what is only needed for beliefs at earlier times than this."""
        time_ns = self._links["time_ns"][: self._n]
        kept = max(int(np.searchsorted(time_ns, before_ns, side="right")) - 1, 0)
        if kept:
            self._links = np.concatenate([self._links[kept : self._n], np.empty(FIRST_CAPACITY, self._links.dtype)])
            self._n -= kept
            self._rests = [(n - kept, belief) for n, belief in self._rests if n >= kept]
