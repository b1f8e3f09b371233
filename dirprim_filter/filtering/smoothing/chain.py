"""The recorded states of one belief, so that later measurements can correct earlier estimates."""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.distributions import gaussian
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.smoothing.bridge import Ends, Gaussian, without
from dirprim_filter.filtering.smoothing.links import LINK, MOVES, Before, Belief, unlinked

PAUSE_NS = 350_000_000
"""A vehicle in sight is seldom missed for so long,"""
LONG, USUAL_OF = 3.0, 9
"""nor for so many times the usual interval between measurements, the median of the last: of sensors that look more
seldom. After it the map may know more of the way than both ends do; below, on GeoLife and Chicago's buses, ways by the
map are 6 to 10 % farther off."""
GAP_NS = 1_000_000_000
"""Measurements farther apart are the ends of a gap; in less no belief forks."""
LABELLED_GAP_NS = 300_000_000_000
"""A vehicle that its sensor names is waited for at least so long: seen again, it existed in between."""
SAME_VEHICLE = 36.0
"""Squared Mahalanobis distance up to which one belief may be the continuation of another."""
HARDEST = 8.0
"""m/s^2: no vehicle turns or brakes harder on average."""
SLACK_M = 5.0
"""Metres, beyond that."""
USUAL = 9.21
"""Squared Mahalanobis distance that one place in a hundred exceeds."""


def may_lead(mean: FloatArray, dt_s: npt.ArrayLike, place: FloatArray) -> BoolArray:
    """(...) whether a vehicle may come, by the hardest turning or braking, from states (..., 4) to places (..., 2)."""
    dt_s = np.asarray(dt_s)
    off = place - mean[..., :2] - dt_s[..., None] * mean[..., 2:]
    return np.asarray(np.hypot(off[..., 0], off[..., 1]) <= SLACK_M + 0.5 * HARDEST * np.square(dt_s))


class Smoothed(NamedTuple):
    """Beliefs about one vehicle, each given all measurements of its chain."""

    time_ns: IntArray  # (n,) ascending
    mean: FloatArray  # (n, 4) x, y and their rates
    covariance: FloatArray  # (n, 4, 4)
    course: FloatArray  # (n, 2) as the filter knew it, for vehicles that stand
    measured_ns: IntArray  # (n,) time of the last measurement by then

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


class Span(NamedTuple):
    """From one measurement of a vehicle to its next."""

    start: Belief  # the filter's at the first
    straight: Gaussian  # that of straight motion there
    samples: States | None  # the filter's there, before a pause
    links: AnyArray  # (m,) of the steps to the second
    took_ns: int
    is_pause: bool


class Chain:
    """What links one belief's measurements, from its birth to the last.

    Args:
        first: at birth.
        straight: that of straight motion.
        samples: the filter's.
        label: what the sensor named it, with its group; empty if it did not.

    Attributes:
        name: of the vehicle; empty until it is reported. One that its sensor named and saw again was there.
        label: as given.
        is_joined: whether it took up another.
        patience_ns: how long its vehicle, if its sensor named it, is waited for.
        existence: the largest reported probability that the track is a vehicle.
        first_ns: time of the first measurement.
        last: the filter's belief at the last measurement.
        straight: that of straight motion.
        samples: the filter's.
        path: the steps since.
        is_replaced: from its last measurement on another chain is of its vehicle.
    """

    def __init__(self, first: Belief, straight: Gaussian, samples: States, label: str = "") -> None:
        self.name, self.label = "", label
        self.is_joined = self.is_replaced = False
        self.existence, self.patience_ns = 0.0, LABELLED_GAP_NS
        self.first_ns = first.time_ns
        self.last, self.straight, self.samples = first, straight, samples
        self.path: list[Before] = []
        self._spans: list[Span] = []

    def is_over(self, now_ns: int, gap_ns: int) -> bool:
        """Whether its vehicle, of which all is known up to a time, will not be measured again as this one."""
        return self.is_replaced or now_ns - self.last.time_ns > (self.patience_ns if self.label else gap_ns)

    def reaches(self, time_ns: IntArray) -> BoolArray:
        """(n,) whether its vehicle is estimated at these times."""
        return (self.first_ns <= time_ns) & (time_ns < self.last.time_ns + (not self.is_replaced))

    def extend(self, links: AnyArray, last: Belief, straight: Gaussian, samples: States) -> None:
        """Add the links (m,) of the path to a new last measurement."""
        took_ns = last.time_ns - self.last.time_ns
        is_pause = took_ns > PAUSE_NS
        if is_pause and self._spans:
            is_pause = took_ns > LONG * np.median([float(span.took_ns) for span in self._spans[-USUAL_OF:]])
        kept = self.samples if is_pause else None
        self._spans.append(Span(self.last, self.straight, kept, links, took_ns, is_pause))
        self.last, self.straight, self.samples, self.path = last, straight, samples, []
        if self.label:
            self.name, self.existence = self.name or self.label, 1.0

    def smoothed(self) -> Smoothed:
        """All beliefs that are kept, given all measurements so far; none between two that are far apart."""
        links = np.concatenate([np.empty(0, LINK), *(span.links for span in self._spans)])
        n, d = links.size, self.last.mean.size
        mean, covariance = np.empty((n + 1, d)), np.empty((n + 1, d, d))
        mean[n], covariance[n] = self.last.mean, self.last.covariance
        of = {name: np.ascontiguousarray(links[name]) for name in LINK.names or ()}
        _kernels.sweep_back(of["ahead"], of["mean"], of["later"], of["gain"], of["spread"], mean, covariance)
        course = np.concatenate([of["course"], self.last.course[None]])
        starts, sizes = [span.start.time_ns for span in self._spans], [span.links.size for span in self._spans]
        measured_ns = np.repeat([*starts, self.last.time_ns], [*sizes, 1])
        time_ns = np.append(links["time_ns"], self.last.time_ns)
        return Smoothed(time_ns, mean[:, :MOVES], covariance[:, :MOVES, :MOVES], course, measured_ns)

    def gaps(self, model: ConstantVelocityKalman, bias_m: FloatArray) -> list[tuple[Ends, States | None]]:
        """Between measurements that are far apart: what straight motion says of both ends, and samples at the start.

        No samples where it is usual that they are nearly as far apart. bias_m: (2,) the sensor's, along and across.
        """
        if not any(span.took_ns > GAP_NS for span in self._spans):
            return []
        known, expected = self._swept(model)
        if self.is_replaced:  # what was measured last is of another vehicle
            known[-1] = expected[-1]
        found, ends = [], [*(span.start for span in self._spans[1:]), self.last]
        for span, end, at, before in zip(self._spans, ends, known[1:], expected, strict=True):
            if span.took_ns > GAP_NS:
                both = Ends(span.start.time_ns, end.time_ns, span.straight, before, without(at, before))
                found.append((both.unbiased(bias_m, (span.start.course, end.course)), span.samples))
        return found

    def gap_after(self, former: Chain, model: ConstantVelocityKalman, bias_m: FloatArray) -> tuple[Ends, States]:
        """The same of the gap from another chain's last measurement to the first of this one."""
        first = self._spans[0].start if self._spans else self.last
        both = Ends.of(model, former.last.time_ns, former.straight, self.first_ns, self._swept(model)[0][0])
        return both.unbiased(bias_m, (former.last.course, first.course)), former.samples

    def _swept(self, model: ConstantVelocityKalman) -> tuple[list[Gaussian], list[Gaussian]]:
        """States of straight motion at all measurements, given all; and at all but the first, given those before."""
        time_ns = np.array([*(span.start.time_ns for span in self._spans), self.last.time_ns])
        mean, covariance = (
            np.array(column) for column in zip(*(span.straight for span in self._spans), self.straight, strict=True)
        )
        dt_s = np.diff(time_ns) * 1e-9
        move = model.transition(dt_s)
        later, shared = (move @ mean[:-1, :, None])[..., 0], move @ covariance[:-1]
        expected = shared @ move.swapaxes(1, 2) + model.noise(dt_s)
        gain = np.linalg.solve(expected, shared).swapaxes(1, 2)
        known, spread, ahead = mean.copy(), covariance.copy(), np.ones(dt_s.size, np.int64)
        gain = np.ascontiguousarray(gain)
        _kernels.sweep_back(ahead, mean, later, gain, covariance[:-1] - gain @ shared, known, spread)
        return [*map(Gaussian, known, spread)], [*map(Gaussian, later, expected)]

    def is_corrected(self, other: Belief) -> bool:
        """Whether the vehicle may be where another belief of the last time has it; that takes the last one's place.

        Else that is of another chain. A vehicle that the filter lost from sight may be as far as the hardest braking or
        turning takes it. The last belief was perhaps too sure: were all covariances since the last pause, or
        measurement, larger by a factor, gains would be the same, and spreads larger by it: by as much as makes the
        distance of the two beliefs a usual one.
        """
        spread = self.last.covariance[:2, :2] + other.covariance[:2, :2] + 1e-12 * np.eye(2)
        squared = float(gaussian.squared_distance(other.mean[:2] - self.last.mean[:2], spread))
        pause = self._last_pause()
        seen = self._spans[pause].start if pause >= 0 else self.last
        dt_s = (other.time_ns - seen.time_ns) * 1e-9
        is_far = dt_s == 0 or not may_lead(seen.mean[:MOVES], dt_s, other.mean[:2])
        if squared > SAME_VEHICLE and is_far:
            self.is_replaced = True
            return False
        for span in self._spans[pause:]:
            span.links["spread"] *= max(squared / USUAL, 1.0)
        self.last, self.path = other, []
        return True

    def take_up(self, former: Chain) -> None:
        """Be the continuation of another chain, from its end to the beginning of this one."""
        earlier = [span._replace(is_pause=False) for span in former._spans]
        took_ns = self.first_ns - former.last.time_ns
        across = Span(former.last, former.straight, former.samples, unlinked(former.last), took_ns, False)
        self._spans = [*earlier, across, *self._spans]
        self.name, self.existence = former.name, max(former.existence, self.existence)
        self.first_ns, self.is_joined = former.first_ns, True

    def tail(self) -> IntArray:
        """Times of the measurements since the last pause, the latest first; none without a pause."""
        if (pause := self._last_pause()) < 0:
            return np.empty(0, np.int64)
        return np.array([self.last.time_ns, *(span.start.time_ns for span in self._spans[:pause:-1])])

    def cut(self) -> None:
        """End at the measurement before the last pause."""
        pause = self._last_pause()
        start = self._spans[pause]
        self.last, self.straight, self._spans = start.start, start.straight, self._spans[:pause]
        self.samples = start.samples or self.samples  # a pause has them

    def forget(self, *, before_ns: int) -> None:
        """Drop what is only needed for beliefs at earlier times than this."""
        del self._spans[: max(bisect_right([span.start.time_ns for span in self._spans], before_ns) - 1, 0)]

    def _last_pause(self) -> int:
        """Which of the spans; -1 without one."""
        return max((i for i, span in enumerate(self._spans) if span.is_pause), default=-1)
